"""Configuration groups: what may be chosen in each, and what a choice holds. Nothing heavy is imported to read them.

A choice is a registered name, whose values are its constructor's defaults, or a file of ``conf/<group>/``, which says
only what differs from them: a file of a registered name changes that one, any other names its ``_target_``. Where its
``defaults`` name another file of its group, it says what differs from that one.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from copy import deepcopy
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from aerial_il import algorithms, policies, robots
from aerial_il.cli import launchers, sweepers
from aerial_il.cli.configuration.defaults import TARGET, classes, completed, has_method
from aerial_il.core import registry
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.suite import tasks

Names = Callable[[], Iterable[str]]

# group -> the room of its files, the names in it, and the method by which the class of settings is known in a file
CONSTRUCTED: Mapping[str, tuple[str, Names, str]] = {
    "algorithm": (algorithms.__name__, algorithms.names, "train"),
    "launcher": (launchers.__name__, launchers.names, "launch"),
    "sweeper": (sweepers.__name__, sweepers.names, "search"),
    "policy": (policies.__name__, policies.names, "build"),
}
NAMED: Mapping[str, Names] = {"robot": robots.names, "task": tasks.names}  # only their name is chosen
STUDY = "bench"  # the group of studies, whose settings are read from the dataclasses themselves
_GLOBAL = "# @package _global_"


@cache
def conf_dir() -> Path:
    """Return the folder of configuration files: beside the code when installed, at the top of a checkout."""
    package = Path(__file__).resolve().parents[2]
    inside = package / "conf"
    return inside if inside.is_dir() else package.parent / "conf"


def groups() -> tuple[str, ...]:
    """Return the names of all configuration groups, Hydra's own left out."""
    folders = {p.name for p in conf_dir().iterdir() if p.is_dir() and p.name not in ("hydra", "__pycache__")}
    return tuple(sorted({STUDY} | folders | CONSTRUCTED.keys() | NAMED.keys()))


def options(group: str) -> tuple[str, ...]:
    """Return what may be chosen in ``group``."""
    return tuple(sorted({*_registered(group), *(p.stem for p in (conf_dir() / group).glob("*.yaml"))}))


def read_option(group: str, name: str) -> dict[str, Any]:
    """Return all that the choice ``name`` of ``group`` holds: its file's values over the constructor's defaults."""
    if name not in options(group):
        raise UnknownNameError(group, name, options(group))
    return deepcopy(_option(group, name))


def is_global(group: str, name: str) -> bool:
    """Whether a choice sets keys of the command, rather than those below the group's own name."""
    file = conf_dir() / group / f"{name}.yaml"
    return file.is_file() and file.read_text(encoding="utf-8").startswith(_GLOBAL)


def target_of(group: str, name: str) -> str:
    """Return the class of settings that the file of a registered policy or algorithm defines.

    Raises:
        InvalidValueError: the file defines none.
    """
    room, _, method = CONSTRUCTED[group]
    found = (f"{room}.{name}.{each}" for each in classes(f"{room}.{name}"))
    target = next((each for each in found if has_method(each, method)), None)
    if target is None:
        raise InvalidValueError(f"{room}.{name} defines no {group}: a dataclass of settings with a method {method}.")
    return target


def leaf_keys(tree: Any, prefix: str = "") -> list[str]:
    """Return the dotted keys of a nested mapping, private ``_target_`` and the like left out."""
    if not isinstance(tree, dict) or not tree:
        return [prefix.rstrip(".")]
    return [leaf for k, v in tree.items() if not str(k).startswith("_") for leaf in leaf_keys(v, f"{prefix}{k}.")]


@cache
def read_yaml(path: Path) -> dict[str, Any]:
    """Return the content of a configuration file."""
    return yaml.safe_load(path.read_text(encoding="utf-8")) or {}


def _registered(group: str) -> tuple[str, ...]:
    if group == STUDY:
        return registry.names("study")
    return tuple(CONSTRUCTED[group][1]() if group in CONSTRUCTED else NAMED.get(group, tuple)())


@cache
def _option(group: str, name: str) -> dict[str, Any]:
    if group == STUDY:
        return {"name": name, **json.loads(json.dumps(asdict(registry.get("study", name)())))}
    said = _said(group, name)
    if group in NAMED:
        return {"name": name, **said}
    if group in CONSTRUCTED and TARGET not in said:
        said = {TARGET: target_of(group, name), **said}
    return completed(said)


def _said(group: str, name: str) -> dict[str, Any]:
    """Return what the file of a choice says, over what the files in its ``defaults`` say; empty without a file."""
    file = conf_dir() / group / f"{name}.yaml"
    said = deepcopy(read_yaml(file)) if file.is_file() else {}
    for entry in said.pop("defaults", []):
        if isinstance(entry, dict):  # "/GROUP@KEY: NAME"
            ((source, chosen),) = entry.items()
            other, _, key = source.removeprefix("/").partition("@")
            said = _over(_at(key.split("."), read_option(other, chosen)), said)
        elif entry != "_self_":  # another choice of this group
            if entry not in options(group):
                raise UnknownNameError(group, entry, options(group))
            said = _over(_said(group, entry), said)
    return said


def _over(base: dict[str, Any], said: dict[str, Any]) -> dict[str, Any]:
    """Return ``base`` with what is said over it; a nested mapping without a ``_target_`` changes that of ``base``."""
    both = {k: (base[k], v) for k, v in said.items() if isinstance(v, dict) and isinstance(base.get(k), dict)}
    return {**base, **said, **{k: _over(*pair) for k, pair in both.items() if TARGET not in pair[1]}}


def _at(path: list[str], value: dict[str, Any]) -> dict[str, Any]:
    """Return a nested mapping that holds ``value`` at ``path``."""
    return {path[0]: _at(path[1:], value)} if path else value
