"""Field constructors for the dataclass of a command, and what help, completion and checks read from it."""

from __future__ import annotations

import dataclasses
import types
import typing
from dataclasses import MISSING as NO_DEFAULT
from dataclasses import Field, dataclass
from typing import Any

from aerial_il.core.errors import InvalidValueError

MOST = {  # key -> the most that is believed: what is beyond was mistyped, or would fill any memory
    "seed": 2**62, "evaluate_seed": 2**62, "evaluation_seed": 2**62,
    "episodes": 1_000_000, "evaluate_episodes": 1_000_000, "evaluation_episodes": 1_000_000,
    "num_envs": 16_384, "threads": 4096, "port": 65_535,
}  # fmt: skip
MISSING: Any = "???"  # what OmegaConf takes for "the user must say"


def key(
    default: Any, help: str, *, choices: tuple[str, ...] = (), position: int | None = None, many: bool = False
) -> Any:
    """Declare one ``key=value`` of a command.

    Args:
        default: its value if nothing is said; ``MISSING`` makes it mandatory.
        help: what it means.
        choices: the valid values, if they are few.
        position: the value may also be typed bare, as this word (from 0) among the bare ones.
        many: it is a list, and every bare word from that position on belongs to it.
    """
    metadata = {"help": help, "choices": choices, "position": position, "many": many}
    if isinstance(default, (list, dict)):
        return dataclasses.field(default_factory=lambda: type(default)(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def group(
    help: str,
    choice: str | None = None,
    *,
    path: bool = False,
    composed: bool = False,
    position: int | None = None,
) -> Any:
    """Declare a key that a choice of the configuration group of that name fills.

    Args:
        help: what it chooses.
        choice: what is taken if nothing is said; None for nothing, and ``key=null`` is then valid.
        path: whether ``key=some/folder`` is short for ``key.path=some/folder``.
        composed: whether ``key=a+b-c``, made of the files' names and others, is short for ``key.name=a+b-c``.
        position: see :func:`key`.
    """
    metadata = {"help": help, "group": True, "choice": choice, "path": path, "composed": composed, "position": position}
    return dataclasses.field(default=None if choice is None else MISSING, metadata=metadata)


def path(
    kind: type[Located] | type[MaybeLocated], help: str, *, value: str | None = None, position: int | None = None
) -> Any:
    """Declare a key whose value is a path although ``conf/`` has a group of that name; ``value`` is its default."""
    metadata = {"help": help, "path": True, "position": position}
    return dataclasses.field(default_factory=kind if value is None else lambda: kind(value), metadata=metadata)


def tier(help: str) -> Any:
    """Declare a key that may name a tier, or none, although ``conf/`` has a group of that name."""
    return dataclasses.field(default_factory=MaybeTier, metadata={"help": help, "composed": True})


def output(default: Any, help: str) -> Any:
    """Declare the key that says where the results go; in a sweep each job gets a folder of its own below it."""
    return dataclasses.field(default=default, metadata={"help": help, "output": True})


def output_key(config: type) -> str:
    """Return the name of the key declared by :func:`output`, empty if the command writes nothing."""
    return next((f.name for f in dataclasses.fields(config) if f.metadata.get("output")), "")


@dataclass
class Named:
    """A group whose files only name an entry of a registry."""

    name: str = MISSING


@dataclass
class TierName(Named):
    """A tier, or one of them with components added or removed, e.g. ``hard-payload``."""

    def __post_init__(self) -> None:
        from aerial_il.suite import tiers

        tiers.get(self.name)


@dataclass
class MaybeTier:
    """The same, where none need be named."""

    name: str | None = None

    def __post_init__(self) -> None:
        if self.name is not None:
            TierName(self.name)


@dataclass
class Located:
    """A key that stands for something on disk: ``key=some/folder`` is short for ``key.path=some/folder``."""

    path: str = MISSING


@dataclass
class MaybeLocated:
    """The same, where nothing need be given."""

    path: str | None = None


def is_group(field: Field[Any]) -> bool:
    return bool(field.metadata.get("group"))


def takes_path(field: Field[Any]) -> bool:
    return bool(field.metadata.get("path"))


def takes_composition(field: Field[Any]) -> bool:
    return bool(field.metadata.get("composed"))


def positional(config: type) -> list[str]:
    """Return the names of the keys whose values may be typed bare, in their order."""
    placed = [f for f in dataclasses.fields(config) if f.metadata.get("position") is not None]
    return [f.name for f in sorted(placed, key=lambda f: f.metadata["position"])]


def takes_many(field: Field[Any]) -> bool:
    return bool(field.metadata.get("many"))


def takes_texts_by_number(config: type, field: Field[Any]) -> bool:
    return typing.get_type_hints(config)[field.name] == dict[int, str]


def default_text(field: Field[Any]) -> str:
    """Return the default as it would be typed, empty if the user must say."""
    value = field.default_factory() if field.default_factory is not NO_DEFAULT else field.default
    if isinstance(value, (Located, MaybeLocated)):
        value = value.path
    if isinstance(value, MaybeTier):
        value = value.name
    if value == MISSING:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return "[" + ",".join(str(v) for v in value) + "]"
    return "null" if value is None else str(value)


def type_text(config: type, field: Field[Any]) -> str:
    """Return a field's type in plain words, e.g. ``whole number``."""
    words = {int: "whole number", float: "number", bool: "true or false", str: "text"}
    hint = typing.get_type_hints(config)[field.name]
    if isinstance(hint, types.UnionType):
        parts = [t for t in typing.get_args(hint) if t is not types.NoneType]
        return f"{words.get(parts[0], str(parts[0]))} or null"
    if typing.get_origin(hint) is list:
        return "list such as [a,b]"
    return words.get(hint, getattr(hint, "__name__", str(hint)))


def check_choices(config: Any) -> None:
    """Refuse a value outside the choices that its key declares."""
    for field in dataclasses.fields(config):
        choices, value = field.metadata.get("choices", ()), getattr(config, field.name)
        if choices and value not in choices:
            raise InvalidValueError(f"{field.name}={value} is not one of {', '.join(choices)}.")


def at_least(config: Any, **limits: float) -> None:
    """Refuse values below their limits, e.g. ``at_least(self, episodes=1, seed=0)``, or beyond what any may be."""
    for name, limit in limits.items():
        value = getattr(config, name)
        if value is not None and value < limit:
            raise InvalidValueError(f"{name}={value} is too small: the minimum is {limit}.")
        if value is not None and name in MOST and value > MOST[name]:
            raise InvalidValueError(f"{name}={value} is too large: the maximum is {MOST[name]}.")
