"""Commands called from Python: keyword arguments are the keys that are typed, checked by the same code."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from typing import Any

from aerial_il.cli import commands
from aerial_il.cli.configuration import spelling
from aerial_il.cli.configuration.compose import compose


def call(name: str, settings: Mapping[str, Any]) -> None:
    """Run the command ``name`` in this process.

    Args:
        name: e.g. ``collect``.
        settings: key -> value. Text is taken as it is typed, so ``tier="gusts"`` and ``policy="act"`` choose; a mapping
            holds the keys of a group, ``{"name": "act", "chunk": 20}`` with its choice; None says nothing.

    Raises:
        AerialError: for every mistake, in the words of the command line; whatever the command itself raises.
    """
    command = commands.find(name)
    command.run(compose(command, [word for key, value in settings.items() for word in _typed(key, value)]))


def _typed(key: str, value: Any) -> Iterator[str]:
    """Yield the words that say ``key`` is ``value``."""
    if value is None:
        return
    if isinstance(value, Mapping):
        if "name" in value:
            yield f"{key}={value['name']}"
        for inner, each in value.items():
            if inner != "name":
                yield from _typed(f"{key}.{inner}", each) if each is not None else (f"{key}.{inner}=null",)
    elif isinstance(value, os.PathLike):
        yield spelling.path(key, os.fspath(value))
    else:
        yield f"{key}={value if isinstance(value, str) else spelling.typed(value)}"
