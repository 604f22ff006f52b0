"""Words to the settings of a workflow: Hydra composes what was said, the dataclasses say what that means."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import MISSING, asdict, fields, is_dataclass
from typing import Any

from aerial_il.core.composition import Key, build, keys
from aerial_il.core.errors import InvalidValueError

_WORD = re.compile(r"(\+{0,2}|~)([\w.]+)=(.*)", re.DOTALL)


def compose[S](kind: type[S], words: list[str]) -> S:
    """Return settings of ``kind`` from ``key=value`` words; what is not said keeps its default."""
    return build(kind, composed(kind, words))


def composed(kind: type, words: list[str]) -> dict[str, Any]:
    """Return what was said as nested plain values; a choice is a mapping with its name. Only Hydra is imported."""
    from hydra import compose as hydra_compose
    from hydra import initialize_config_module
    from hydra.core.config_store import ConfigStore
    from hydra.core.global_hydra import GlobalHydra
    from hydra.errors import HydraException
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    ConfigStore.instance().store(name=kind.__name__, node=_node(kind))
    GlobalHydra.instance().clear()
    try:
        with initialize_config_module("aerial_il.cli", version_base="1.3"):
            cfg = hydra_compose(kind.__name__, [_override(kind, word) for word in words])
            return OmegaConf.to_container(cfg, resolve=True)  # type: ignore[return-value]
    except (HydraException, OmegaConfBaseException) as error:
        raise InvalidValueError(f"{' '.join(str(error.__cause__ or error).split())}") from error


def sweep(kind: type, words: list[str]) -> list[list[str]]:
    """Return the words of each point of a sweep."""
    from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
    from hydra.core.override_parser.overrides_parser import OverridesParser

    parsed = OverridesParser.create().parse_overrides([_override(kind, word) for word in words])
    return [
        list(point) for (point,) in ([each] for batch in BasicSweeper.split_arguments(parsed, None) for each in batch)
    ]


def help_of(kind: type, words: list[str]) -> str:
    """Return the keys of ``kind`` and of what ``words`` choose: default and meaning of each."""
    return "\n".join(_row(key) for key in known(kind, words))


def known(kind: type, words: list[str]) -> Iterator[Key]:
    """Yield every key, those of the choices in ``words`` too; their modules are imported."""
    from aerial_il.workflows.chosen import chosen

    said = dict(word.split("=", 1) for word in words if "=" in word)
    for key in keys(kind):
        yield key
        if key.name in getattr(kind, "CHOICES", {}) and key.name in said:
            settings = chosen(key.name, said[key.name])
            yield from keys(type(settings), base=settings, at=f"{key.name}.")


def _node(kind: type) -> dict[str, Any]:
    """Return the defaults of a workflow, for values to refer to, with each choice as a mapping of its name."""
    defaults = {f.name: f.default for f in fields(kind) if f.default is not MISSING}
    values = {name: asdict(value) if is_dataclass(value) else value for name, value in defaults.items()}
    return values | {group: {"name": name} for group, name in getattr(kind, "CHOICES", {}).items()}


def _override(kind: type, word: str) -> str:
    """Return a word as Hydra takes it: every key may be added, since :func:`build` knows which there are."""
    from aerial_il.cli.configuration.quoting import literal

    if not (found := _WORD.fullmatch(word)):
        raise InvalidValueError(f"{word!r} is not KEY=VALUE.")
    _, name, value = found.groups()
    if name in getattr(kind, "CHOICES", {}):
        return f"{name}.name={value}"
    text = {f.name for f in fields(kind) if f.type in ("str", "str | None", "Dataset")} | {"dataset.path"}
    return f"++{name}={literal(value) if name in text and value != 'null' else value}"


def _row(key: Key) -> str:
    default = "" if key.default is None else key.default
    shown = "null" if key.default is None else str(list(default) if isinstance(default, tuple) else default)
    return f"  {key.name + '=' + shown:<44}  {key.meaning}"
