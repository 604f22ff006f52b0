"""Say in words of the command line what a configuration holds."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

from aerial_il.cli.configuration import groups
from aerial_il.cli.configuration.quoting import literal


def path(key: str, place: str) -> str:
    """Return ``key=place`` such that ``place`` is not taken for one of the files of ``conf/<key>/``, or for nothing."""
    meant = key in groups.groups() and place in groups.options(key)
    return f"{key}=./{place}" if meant or place == "null" else f"{key}={place}"


def of_group(group: str, settings: Mapping[str, Any], *, default: str) -> list[str]:
    """Return the shortest words that lead to ``settings``: the nearest file of the group, and what differs from it.

    Args:
        group: a folder of ``conf/``.
        settings: the composed content.
        default: the file that the command takes if nothing is said.
    """
    ways = []
    for name in sorted(groups.options(group), key=lambda option: option != default):
        chosen = [] if name == default else [f"{group}={name}"]
        ways.append(chosen + changed(group, groups.read_option(group, name), settings))
    return min(ways, key=len)


def changed(prefix: str, usual: Mapping[str, Any], chosen: Mapping[str, Any]) -> list[str]:
    """Return ``~prefix.key`` for all that ``chosen`` lacks, ``prefix.key=value`` for what ``usual`` has not.

    A key that ``usual`` has no place for is added, ``+prefix.key=value``.
    """
    before, added = flat(usual), tuple(f"{key}." for key in removed(chosen, usual))
    given = [
        f"{'+' * f'{key}.'.startswith(added)}{prefix}.{key}="
        f"{value if isinstance(before.get(key), str) and isinstance(value, str) else typed(value)}"
        for key, value in flat(chosen).items()
        if before.get(key) != value
    ]
    return [*(f"~{prefix}.{key}" for key in removed(usual, chosen)), *given]


def removed(usual: Mapping[str, Any], chosen: Mapping[str, Any], prefix: str = "") -> list[str]:
    """Return the dotted keys, of whole branches where they are gone, that ``usual`` has and ``chosen`` has not."""
    keys: list[str] = []
    for name, value in usual.items():
        if name not in chosen:
            keys.append(f"{prefix}{name}")
        elif isinstance(value, Mapping) and isinstance(chosen[name], Mapping):
            keys += removed(value, chosen[name], f"{prefix}{name}.")
    return keys


def flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return dotted keys -> values of a nested mapping."""
    leaves: dict[str, Any] = {}
    for name, value in tree.items():
        leaves |= flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return leaves


def typed(value: Any) -> str:
    """Return a value as it is typed: without quotes where its strings are plain words."""
    if isinstance(value, str):
        return value if re.fullmatch(r"[\w./+-]*", value, re.ASCII) else literal(value)
    if isinstance(value, list | tuple):
        return "[" + ",".join(map(typed, value)) + "]"
    if isinstance(value, Mapping):
        return "{" + ",".join(f"{name}:{typed(inner)}" for name, inner in value.items()) + "}"
    return json.dumps(value)
