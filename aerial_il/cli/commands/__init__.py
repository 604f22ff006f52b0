"""One file per command, in folders by theme, found by being there.

A file has a docstring (summary, text, examples), ``SETTINGS``, the dataclass of its keys, and ``run(settings)``;
perhaps ``BARE``, the keys whose values may be typed without their names, in their order, and ``OUTPUT``, the key that
says where results go, below which each job of a sweep gets a folder. At the top of these files stand light imports
only, for help and completion to answer at once.
"""

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
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
        settings: dataclass of the keys.
        run: does the work, and prints what came of it.
        bare, output: as above; no output for a command that writes nothing.
        shards: of a command whose work can be divided: settings -> for each part, words and a folder for its log.
        together: of a command whose results are worth comparing: prints what the folders of a sweep hold.
    """

    name: str
    doc: str
    settings: type
    run: Callable[[Any], None]
    bare: tuple[str, ...] = ()
    output: str = ""
    shards: Callable[[Any], list[tuple[tuple[str, ...], str]]] | None = None
    together: Callable[[Sequence[str]], None] | None = None

    @property
    def summary(self) -> str:
        return self.doc.splitlines()[0]

    @property
    def hint(self) -> str:
        """What to read next, at the end of an error."""
        return f"See: aerial-il {self.name} --help"


def names() -> tuple[str, ...]:
    """Return the names of all commands."""
    return tuple(sorted(_modules()))


def find(name: str) -> Command:
    """Import one command by its name."""
    if name not in names():
        raise UnknownNameError("command", name, names(), "See: aerial-il --help")
    module = importlib.import_module(_modules()[name])
    more = {each: getattr(module, each.upper()) for each in ("bare", "output") if hasattr(module, each.upper())}
    doc, shards = (module.__doc__ or "").strip(), getattr(module, "shards", None)
    together = getattr(module, "together", None)
    return Command(name, doc, module.SETTINGS, module.run, **more, shards=shards, together=together)


@cache
def _modules() -> dict[str, str]:
    """Return each command's module; its name is that of the file, whichever folder the file is in."""
    files = Path(__file__).parent.glob("*/[a-z]*.py")
    return {file.stem: f"{__name__}.{file.parent.name}.{file.stem}" for file in files}
