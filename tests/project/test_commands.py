"""Every command line that a page, a notebook or a study shows composes: its keys are known, its values fit."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from aerial_il.cli import commands
from aerial_il.cli.compose import points, settings_of, space
from aerial_il.cli.known import known
from aerial_il.cli.words import SWEEPER, read
from aerial_il.core.errors import AerialError
from aerial_il.core.schema import options

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
)  # the reader writes them


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
    said = read(command, words)
    if said.apart[SWEEPER]:
        assert space(command, said.overrides)
    elif said.sweeps:
        assert all(settings_of(command, point) for point, _ in points(command, said.overrides))
    else:
        settings_of(command, said.overrides)


def lines() -> Iterator[Any]:
    for page in (*PAGES, *NOTEBOOKS):
        for line in dict.fromkeys(shown(page)):
            if not OPEN.search(line) and not any(name in line for name in EXAMPLES):
                yield pytest.param(line, id=f"{page.relative_to(ROOT)}: {line}")


@pytest.mark.parametrize("line", [*lines()])
def test_a_command_that_is_shown_composes(line: str) -> None:
    check(line)


@pytest.mark.parametrize("words", ["train run=x algorithm.stepz=3", "collect robott=quad", "flyy"])
def test_a_command_that_does_not_compose_is_seen(words: str) -> None:
    with pytest.raises(AerialError):
        check(f"aerial-il {words}")


def settings(group: str) -> set[str]:
    """Return all keys of all choices of a group, and the groups of keys."""
    train, gates = commands.find("train").settings, {f"{group}.gate": list(options("gate"))}
    every = known(train, {group: list(options(group)), **(gates if group == "algorithm" else {})})
    result = {name.removeprefix(f"{group}.") for name in every if name.startswith(f"{group}.")}
    return result | {".".join(name.split(".")[:i]) for name in result for i in range(1, name.count(".") + 1)}


@pytest.mark.parametrize("group", ["algorithm", "policy"])
def test_settings_named_in_sentences_are_there(group: str) -> None:
    there = settings(group)
    named = {
        (str(page.relative_to(ROOT)), name)
        for page in PAGES
        if page.name != "CHANGELOG.md"
        for kind, name in INSIDE.findall(page.read_text(encoding="utf-8"))
        if kind == group
    }
    assert sorted((page, name) for page, name in named if name not in there and name != "name") == []
