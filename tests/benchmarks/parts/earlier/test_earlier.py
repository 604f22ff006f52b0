"""An earlier commit answers with its own package, from a process of its own."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

import aerial_il
from aerial_il.benchmarks.parts.earlier.checkout import Checkout, PeerError, turns
from aerial_il.benchmarks.parts.earlier.rivals import rivals
from aerial_il.core.errors import InvalidValueError

SCRIPT = """
import os
import aerial_il
count = 0

def who():
    print("libraries talk")
    return [aerial_il.NAME, os.getpid()]

def add(value):
    global count
    count += value
    return count
"""


@pytest.fixture
def other(tmp_path: Path) -> Checkout:
    """Another package of our name."""
    package = tmp_path / "other" / "aerial_il"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("NAME = 'other'\n")
    return Checkout(package.parent)


def test_each_side_runs_its_own_package(other: Checkout) -> None:
    with (
        other.serve(SCRIPT) as theirs,
        Checkout.here().serve("import aerial_il\ndef file(): return aerial_il.__file__") as ours,
    ):
        name, process = theirs.ask("who")
        assert name == "other"
        assert process != os.getpid()
        assert ours.ask("file") == aerial_il.__file__


def test_only_what_both_commits_have_is_compared(other: Checkout) -> None:
    (other.path / "aerial_il" / "__init__.py").write_text(
        "def list_cells(): return (('quad', 'hover'), ('bird', 'land'))\n"
    )
    with rivals(other.path, repetitions=1, num_envs=1, threads=1) as both:
        assert both.know("quad", "hover")
        assert not both.know("quad", "land"), "the earlier one lacks it"
        assert not both.know("bird", "land"), "and this one that"


def test_what_a_script_holds_stays_between_questions_and_the_first_round_does_not_count(other: Checkout) -> None:
    with other.serve(SCRIPT) as one, other.serve(SCRIPT) as two:
        one.ask("add", value=10)
        assert turns({"one": one, "two": two}, 2, "add", value=1) == {"one": [12, 13], "two": [2, 3]}


def test_a_script_that_fails_is_an_error_of_that_checkout(other: Checkout) -> None:
    with pytest.raises(PeerError, match="other: add failed with exit status 1"), other.serve(SCRIPT) as peer:
        peer.ask("add", value="x")
    with pytest.raises(PeerError, match="ready failed"), other.serve("1 / 0"):
        pass


def test_an_interpreter_that_imports_another_package_is_found_out(other: Checkout, tmp_path: Path) -> None:
    """The cheat: a peer that is in truth our own package, and therefore just as fast."""
    liar = tmp_path / "python"
    root = Path(aerial_il.__file__).parents[1]
    liar.write_text(f'#!/bin/sh\nPYTHONPATH={root} exec {sys.executable} "$@"\n')
    liar.chmod(0o755)
    with pytest.raises(PeerError, match="imports another aerial_il"), Checkout(other.path, str(liar)).serve(""):
        pass


def test_a_folder_without_the_package_is_refused_with_the_way_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="git worktree add PATH COMMIT"):
        Checkout(tmp_path)
    with pytest.raises(InvalidValueError, match="is no interpreter"):
        Checkout(Path(aerial_il.__file__).parents[1], "/nowhere/python")


def test_a_checkout_tells_its_commit(other: Checkout) -> None:
    assert len(Checkout.here().commit.rstrip("+")) == 10
    assert other.commit == "unknown"
