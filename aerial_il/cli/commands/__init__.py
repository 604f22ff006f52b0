"""One file per command, in rooms by theme: a docstring, a ``Config`` dataclass of its keys and ``run(config)``.

A new file in one of the rooms is a new command. At the top of these files only light imports
stand, so that help and completion answer at once.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

from aerial_il.core.errors import UnknownNameError


@dataclass(frozen=True)
class Command:
    """A command as its module declares it.

    Attributes:
        name: what is typed after ``aerial-il``.
        doc: the module's docstring; its first line is the summary.
        config: dataclass of the keys.
        run: does the work; what it returns is printed by nobody.
        shards: of a command whose work can be divided: configuration -> for each part, words and a folder for its log.
    """

    name: str
    doc: str
    config: type
    run: Callable[[Any], None]
    shards: Callable[[Any], list[tuple[tuple[str, ...], str]]] | None = None

    @property
    def summary(self) -> str:
        return self.doc.splitlines()[0]

    @property
    def choices(self) -> dict[str, str | None]:
        """Configuration group -> what is chosen in it if nothing is said.

        The groups of its keys, and those whose choices are sets of values for its keys, ``Config.PRESETS``.
        """
        own = {f.name: f.metadata["choice"] for f in fields(self.config) if f.metadata.get("group")}
        return own | getattr(self.config, "PRESETS", {})


def names() -> tuple[str, ...]:
    """Return the names of all commands."""
    return tuple(sorted(_modules()))


def find(name: str) -> Command:
    """Import one command by its name."""
    if name not in names():
        raise UnknownNameError("command", name, names(), "See: aerial-il --help")
    module = importlib.import_module(_modules()[name])
    return Command(name, (module.__doc__ or "").strip(), module.Config, module.run, getattr(module, "shards", None))


@cache
def _modules() -> dict[str, str]:
    """Return each command's module; its name is that of the file, whichever room the file is in."""
    files = Path(__file__).parent.glob("*/[a-z]*.py")
    return {file.stem: f"{__name__}.{file.parent.name}.{file.stem}" for file in files}
