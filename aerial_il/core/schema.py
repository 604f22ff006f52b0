"""What settings there are: names, types, defaults and meanings, read from dataclasses and their docstrings.

Where a hint carries a :class:`Choice`, settings are chosen by name among what is registered; a preset of that kind,
``conf/KIND/NAME.yaml``, is a name too. Where it carries a :class:`Name`, the value must be a registered name.
"""

import importlib
import inspect
import re
import types
import typing
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from functools import cache
from typing import Annotated, Any, Union, get_args, get_origin

from aerial_il.core import presets, registry
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.renamed import moved

_MEANING = re.compile(r"^    ((?:\w+, )*\w+): (.+(?:\n {8,}.+)*)", re.MULTILINE)
_ANOTHER = re.compile(r"(?<=[.;]) ((?:\w+, )*\w+): ")
FROM = "from"  # key of earlier work whose settings are taken
_LISTED = {"tier": "aerial_il.suite.tiers"}  # names that stand in no files of their own


@dataclass(frozen=True)
class Choice:
    """Of a hint: settings that are chosen by name, e.g. ``Annotated[Any, Choice("policy")]``."""

    kind: str


@dataclass(frozen=True)
class Name:
    """Of a hint: a name of that kind, e.g. ``Annotated[str, Name("robot")]``."""

    kind: str

    def check(self, name: str) -> None:
        if self.kind in _LISTED:
            importlib.import_module(_LISTED[self.kind]).get(name)  # a tier may be put together: gusts+latency
        elif name not in (known := options(self.kind)):
            raise UnknownNameError(self.kind, name, known, "See: aerial-il list")


def options(kind: str) -> tuple[str, ...]:
    """Return what may be chosen of a kind: what is registered, and presets."""
    if kind in _LISTED:
        return tuple(sorted(importlib.import_module(_LISTED[kind]).names()))
    return tuple(sorted({*(registry.names(kind) if kind in registry.KINDS else ()), *presets.names(kind)}))


@dataclass(frozen=True)
class Key:
    """One setting, in words.

    Attributes:
        name: dotted. default: as it is typed, empty where it must be given. meaning: what its docstring says.
        takes: ``text``, ``texts``, ``mapping``, ``value``, ``place`` (a group that a path or a preset stands for),
            ``choice`` or ``preset``.
        nullable: whether ``null`` is nothing. options: the valid values, if they are few.
        kind: of what is chosen or named.
    """

    name: str
    default: str
    meaning: str
    takes: str = "value"
    nullable: bool = False
    options: tuple[str, ...] = ()
    kind: str = ""


def keys(kind: type, *, base: Any = None, at: str = "") -> Iterator[Key]:
    """Yield every setting of ``kind``, nested ones in their place, with the defaults of ``base`` or its own.

    Of a choice its name alone: what it has depends on what is chosen.
    """
    said, hints = meanings(kind), hints_of(kind)
    for field in (field for field in fields(kind) if field.init):
        default, hint = getattr(base, field.name) if base is not None else default_of(field), hints[field.name]
        key, inner = _key(f"{at}{field.name}", hint, default, said.get(field.name, "")), group_of(hint, default)
        if key.takes in ("place", "choice") or inner is None or default is None:
            yield key
        if inner is not None and key.takes != "choice":
            yield from keys(inner, base=None if default in (None, MISSING) else default, at=f"{at}{field.name}.")
    for name, meaning in getattr(kind, "PRESETS", {}).items():
        yield Key(name, "null", f"{meaning}: {', '.join(presets.names(name))}", "preset", nullable=True, kind=name)
    if (like := getattr(kind, "like", None)) is not None:
        yield Key(f"{at}{FROM}", "null", inspect.cleandoc(like.__doc__ or ""), "text", nullable=True)


@cache
def meanings(kind: type) -> Mapping[str, str]:
    """Return what the docstrings of ``kind`` and of its bases say of each setting."""
    meant: dict[str, str] = {}
    for each in reversed(kind.__mro__):
        _, _, said = inspect.cleandoc(each.__doc__ or "").partition("Attributes:\n")
        for names, text in _MEANING.findall(said):
            meant |= _parted(names, " ".join(text.split()), {*getattr(each, "__dataclass_fields__", ())})
    return meant


def _parted(names: str, text: str, known: set[str]) -> dict[str, str]:
    """Return what is said of each name, of a line that goes on with others: ``low: the least. high: the most.``"""
    for place in _ANOTHER.finditer(text):
        if known.issuperset(others := place[1].split(", ")):
            return dict.fromkeys(names.split(", "), text[: place.start()]) | _parted(
                ", ".join(others), text[place.end() :], known
            )
    return dict.fromkeys(names.split(", "), text)


def unknown_key(name: str, known: Iterable[str], hint: str = "") -> InvalidValueError | UnknownNameError:
    """Return the error for a key that there is not among all that are ``known``; an old one leads to its new name."""
    every, (head, dot, _) = list(known), name.rpartition(".")
    if (new := moved(name, every)) is not None and head:
        return InvalidValueError(f"{name} is called {new} now. {hint}".rstrip())
    beside = f"{head}{dot}"
    near = [beside + each.removeprefix(beside).partition(".")[0] for each in every if each.startswith(beside)]
    return UnknownNameError("key", name, dict.fromkeys(near or [each.partition(".")[0] for each in every]), hint)


def shown(default: Any, kind: str = "") -> str:
    """Return a default as it is typed."""
    if default is MISSING:
        return ""
    if is_dataclass(default):
        return registry.name_of(kind, type(default)) if kind else str(getattr(default, "path", None) or "null")
    if isinstance(default, Mapping):
        return "{" + ",".join(f"{name}:{shown(each)}" for name, each in default.items()) + "}"
    if isinstance(default, tuple | list):
        return "[" + ",".join(shown(each) for each in default) + "]"
    return str(default).lower() if isinstance(default, bool) else "null" if default is None else str(default)


@cache
def hints_of(kind: type) -> Mapping[str, Any]:
    """Return the declared types of a dataclass, with what they are annotated with."""
    return typing.get_type_hints(kind, include_extras=True)


def default_of(field: Field[Any]) -> Any:
    return field.default if field.default_factory is MISSING else field.default_factory()


def bare(hint: Any) -> Any:
    """Return a hint without what it is annotated with."""
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


def marked[M](hint: Any, mark: type[M]) -> M | None:
    """Return the mark of a hint that is annotated with one, ``Annotated[...] | None`` too."""
    for each in (hint, *(get_args(hint) if get_origin(hint) in (Union, types.UnionType) else ())):
        marks = each.__metadata__ if get_origin(each) is Annotated else ()
        if (marked := next((one for one in marks if isinstance(one, mark)), None)) is not None:
            return marked
    return None


def group_of(hint: Any, default: Any) -> type | None:
    """Return the dataclass that a hint stands for, ``Prior`` of ``Prior | None``; None for a single value."""
    if is_dataclass(default) and not isinstance(default, type):
        return type(default)
    plain = bare(hint)
    variants = get_args(plain) if get_origin(plain) in (Union, types.UnionType) else (plain,)
    return next((each for each in map(bare, variants) if is_dataclass(each) and isinstance(each, type)), None)


def _key(name: str, hint: Any, default: Any, meaning: str) -> Key:
    choice, named, plain = marked(hint, Choice), marked(hint, Name), bare(hint)
    variants = get_args(plain) if get_origin(plain) in (Union, types.UnionType) else (plain,)
    literal = next((each for each in variants if get_origin(each) is typing.Literal), None)
    inner, takes = group_of(hint, default), "value"
    if choice is not None:
        takes = "choice"
    elif inner is not None and ("path" in inner.__dataclass_fields__ or presets.names(name)):
        takes = "place"
    elif str in variants or (literal is not None and all(isinstance(each, str) for each in get_args(literal))):
        takes = "text"
    elif any(get_origin(each) is tuple and get_args(each)[0] is str for each in variants):
        takes = "texts"
    elif any(isinstance(get_origin(each), type) and issubclass(get_origin(each), Mapping) for each in variants):
        takes = "mapping"
    few = tuple(map(str, get_args(literal))) if literal is not None else ("true", "false") if plain is bool else ()
    kind = choice.kind if choice is not None else named.kind if named is not None else ""
    return Key(name, shown(default, kind), meaning, takes, types.NoneType in variants, few, kind)
