"""Every command line that a page, a notebook or a study shows composes: its keys are known, its values fit."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from aerial_il.cli import commands
from aerial_il.cli.compose import compose, points
from aerial_il.cli.words import read
from aerial_il.core import registry
from aerial_il.core.composition import plain
from aerial_il.core.errors import AerialError
from aerial_il.core.schema import keys

ROOT = Path(__file__).parents[2]
PAGES = sorted({*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("experiments/*/README.md")})
NOTEBOOKS = sorted(ROOT.glob("notebooks/**/*.py"))
FENCED = re.compile(r"^ *```(?:sh|bash|console|)\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
OPEN = re.compile(r"\.\.\.|…|\b(?:NAME|COMMAND|KIND|LINE)\b")  # left to the reader
SKIPPED = ("completion", "help")  # no keys
INSIDE = re.compile(r"`(algorithm|policy)\.([a-z_]+(?:\.[a-z_]+)*)(?:=[^`]*)?`")  # a setting named in a sentence
EXAMPLES = (
    "touch_point",
    "touch_ball",
    "linear",
    "gull",
    "two_joint_hexa",
    "hovering",
    "tern",
)  # written by the reader first


def shown(page: Path) -> list[str]:
    """Return the command lines that a page shows, each on one line."""
    text = page.read_text(encoding="utf-8")
    blocks = FENCED.findall(text) if page.suffix == ".md" else re.findall(r"^# ?(.*)$", text, re.MULTILINE)
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    lines = [" ".join(line.split()).removeprefix("$ ") for line in lines]
    return [line for line in lines if line.startswith("aerial-il ")]


def check(line: str) -> None:
    """Compose a command line as the console script would.

    Raises:
        AerialError: an unknown key, a value that does not fit, a word too many.
    """
    name, *words = shlex.split(line.removesuffix("&"), comments=True)[1:]
    if name in SKIPPED or {"-h", "--help", "--version"} & {name, *words}:
        return
    command = commands.find(name)
    typed = read(command, words)
    assert points(command, typed.overrides) if typed.sweeps else compose(command, words)


def lines() -> Iterator[Any]:
    for page in (*PAGES, *NOTEBOOKS):
        for line in dict.fromkeys(shown(page)):
            if not OPEN.search(line) and not any(name in line for name in EXAMPLES):
                yield pytest.param(line, id=f"{page.relative_to(ROOT)}: {line}")


@pytest.mark.parametrize("line", lines())
def test_a_command_that_is_shown_composes(line: str) -> None:
    check(line)


@pytest.mark.parametrize("words", ["train run=x algorithm.stepz=3", "collect robott=quad", "flyy"])
def test_a_command_that_does_not_compose_is_seen(words: str) -> None:
    with pytest.raises(AerialError):
        check(f"aerial-il {words}")


def leaves(values: Mapping[str, Any], at: str = "") -> Iterator[str]:
    for name, value in values.items():
        yield from leaves(value, f"{at}{name}.") if isinstance(value, Mapping) else (f"{at}{name}",)


def settings(group: str) -> set[str]:
    """Return all keys of all choices of a group, and the groups of keys."""
    choices = [registry.get(group, name)() for name in registry.names(group)]
    found = {key.name for choice in choices for key in keys(type(choice), base=choice)}
    found |= {name for choice in choices for name in leaves(plain(choice))}  # of what is a choice itself, as a gate is
    return found | {".".join(name.split(".")[:i]) for name in found for i in range(1, name.count(".") + 1)}


@pytest.mark.parametrize("group", ["algorithm", "policy"])
def test_settings_named_in_sentences_are_there(group: str) -> None:
    known = settings(group)
    named = {
        (str(page.relative_to(ROOT)), name)
        for page in PAGES
        if page.name != "CHANGELOG.md"
        for kind, name in INSIDE.findall(page.read_text(encoding="utf-8"))
        if kind == group
    }
    assert sorted((page, name) for page, name in named if name not in known and name != "name") == []
