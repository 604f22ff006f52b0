"""The files of ``conf/``: which groups there are, what may be chosen, what a choice holds. Reads them without Hydra."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import yaml

from aerial_il.core.errors import UnknownNameError


@cache
def conf_dir() -> Path:
    """Return the folder of configuration files: beside the code when installed, at the top of a checkout."""
    package = Path(__file__).resolve().parents[1]
    inside = package / "conf"
    return inside if inside.is_dir() else package.parent / "conf"


def groups() -> tuple[str, ...]:
    """Return the names of all configuration groups, Hydra's own left out."""
    return tuple(sorted(p.name for p in conf_dir().iterdir() if p.is_dir() and p.name not in ("hydra", "__pycache__")))


def options(group: str) -> tuple[str, ...]:
    """Return what may be chosen in ``group``."""
    return tuple(sorted(p.stem for p in (conf_dir() / group).glob("*.yaml")))


def read_option(group: str, name: str) -> dict[str, Any]:
    """Return the content of ``conf/<group>/<name>.yaml``, with what its defaults list takes from other groups."""
    if name not in options(group):
        raise UnknownNameError(group, name, options(group))
    content = dict(_read(conf_dir() / group / f"{name}.yaml"))
    for entry in content.pop("defaults", []):
        if isinstance(entry, dict):  # "/GROUP@KEY: NAME"
            ((source, chosen),) = entry.items()
            other, _, key = source.removeprefix("/").partition("@")
            _place(content, key.split("."), read_option(other, chosen))
    return content


def _place(tree: dict[str, Any], path: list[str], value: dict[str, Any]) -> None:
    """Put ``value`` at ``path``; what stands there already goes over it, as the file's own values do in Hydra."""
    for name in path[:-1]:
        tree[name] = dict(tree.get(name) or {})
        tree = tree[name]
    tree[path[-1]] = {**value, **(tree.get(path[-1]) or {})}


def default_choices(command: str) -> dict[str, str | None]:
    """Return ``group -> chosen file`` as the defaults list of ``conf/<command>.yaml`` has it."""
    chosen: dict[str, str | None] = {}
    for entry in _read(conf_dir() / f"{command}.yaml").get("defaults", []):
        if isinstance(entry, dict):
            group, name = next(iter(entry.items()))
            if group != "hydra" and not group.startswith("override "):
                chosen[group.removeprefix("optional ")] = name
    return chosen


def leaf_keys(tree: Any, prefix: str = "") -> list[str]:
    """Return the dotted keys of a nested mapping, private ``_target_`` and the like left out."""
    if not isinstance(tree, dict) or not tree:
        return [prefix.rstrip(".")]
    return [leaf for k, v in tree.items() if not str(k).startswith("_") for leaf in leaf_keys(v, f"{prefix}{k}.")]


@cache
def _read(path: Path) -> dict[str, Any]:
    return yaml.safe_load(path.read_text(encoding="utf-8")) or {}
