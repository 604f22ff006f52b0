"""``Next:`` lines, read as a shell and the program read them."""

import shlex
from typing import Any

from aerial_il.cli import commands
from aerial_il.cli.compose import compose


def next_commands(said: str) -> list[Any]:
    """Return the settings that each ``Next:`` line of an output leads to; one that does not parse raises."""
    lines = (shlex.split(line.removeprefix("Next:")) for line in said.splitlines() if line.startswith("Next:"))
    return [compose(commands.find(name), words) for program, name, *words in lines if program == "aerial-il"]
