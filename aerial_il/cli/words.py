"""Say in words of the command line what a configuration holds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from aerial_il.cli import conf


def of_group(group: str, settings: Mapping[str, Any], *, default: str) -> list[str]:
    """Return the shortest words that lead to ``settings``: the nearest file of the group, and what differs from it.

    Args:
        group: a folder of ``conf/``.
        settings: the composed content.
        default: the file that the command takes if nothing is said.
    """
    ways = []
    for name in sorted(conf.options(group), key=lambda option: option != default):
        chosen = [] if name == default else [f"{group}={name}"]
        ways.append(chosen + changed(group, conf.read_option(group, name), settings))
    return min(ways, key=len)


def changed(prefix: str, usual: Mapping[str, Any], chosen: Mapping[str, Any]) -> list[str]:
    """Return ``prefix.key=value`` for every value of ``chosen`` that ``usual`` has not."""
    before = flat(usual)
    return [f"{prefix}.{key}={typed(value)}" for key, value in flat(chosen).items() if before.get(key) != value]


def flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return dotted keys -> values of a nested mapping."""
    leaves: dict[str, Any] = {}
    for name, value in tree.items():
        leaves |= flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return leaves


def typed(value: Any) -> str:
    """Return a value as it is typed."""
    return json.dumps(value).replace(" ", "").replace('"', "")
