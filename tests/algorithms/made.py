"""Settings from a table of small values, of which each algorithm takes those that are its own."""

from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from typing import Any

from aerial_il import algorithms
from aerial_il.core.composition import build
from aerial_il.core.renamed import moved
from aerial_il.core.schema import keys


def made(cls: type[Any], values: Mapping[str, Any], base: Any = None) -> Any:
    """Return settings of ``cls`` with those of the values that are its own, in whichever group they stand.

    Raises:
        AssertionError: no algorithm at all has one of the names, so that it would change nothing anywhere.
    """
    assert not (unknown := {name for name in values if all(_key(name, has) is None for has in _everywhere())}), unknown
    tree: dict[str, Any] = {}
    for name, value in values.items():
        if (key := _key(name, names(cls))) is not None:
            *groups, last = key.split(".")
            node = tree
            for group in groups:
                node = node.setdefault(group, {})
            node[last] = value
    return build(cls, tree, base=base)


@cache
def names(cls: type[Any]) -> frozenset[str]:
    """Return the dotted names of all settings of ``cls``, and of its groups."""
    return frozenset(key.name for key in keys(cls)) | {field.name for field in fields(cls)}


@cache
def _everywhere() -> tuple[frozenset[str], ...]:
    return tuple(names(algorithms.get(name)) for name in algorithms.names())


def _key(name: str, has: frozenset[str]) -> str | None:
    """Return the key that a name stands for among those that there are, by its new place if it has moved."""
    key = moved(name, has) or name
    return key if key in has else None
