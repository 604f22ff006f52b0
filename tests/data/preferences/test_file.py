"""Files of preferences: what was said stays after a kill, and what is damaged or somebody else's is answered."""

import json
import os
import signal
import warnings
from pathlib import Path

import pytest

from aerial_il.core.errors import DemoError, InvalidValueError
from aerial_il.data.preferences.file import HEADER, PreferenceFile, read_preferences
from aerial_il.data.preferences.pairs import Preference, Segment

LENGTHS = {"a": 20, "b": 20}
SAID = [
    Preference(Segment("a", 0, 5), Segment("b", 3, 5), "left", "hand"),
    Preference(Segment("b", 1, 5), Segment("a", 15, 5), "equal", "script"),
    Preference(Segment("a", 2, 5), Segment("b", 2, 5), "right", "hand"),
]


def write(path: Path, said: list[Preference]) -> None:
    with PreferenceFile(path, LENGTHS) as file:
        for preference in said:
            file.add(preference)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write(tmp_path / "said.jsonl", SAID)
    return tmp_path / "said.jsonl"


def test_what_was_said_is_read(path: Path) -> None:
    assert read_preferences(path, LENGTHS) == SAID


def test_cut_anywhere_it_is_gone_on_with(path: Path, tmp_path: Path) -> None:
    whole = path.read_bytes()
    for size in range(len(whole) + 1):
        cut = tmp_path / "cut.jsonl"
        cut.write_bytes(whole[:size])
        if size and b"aerial_il" not in whole[:size]:
            continue  # nothing that would be known as ours
        with PreferenceFile(cut, LENGTHS) as file:
            held = list(file.preferences)
            ended = whole[:size].count(b"\n") + (
                whole[size : size + 1] == b"\n"
            )  # all but the end of its line is there
            assert held == SAID[: max(0, ended - 1)]
            for preference in SAID[len(held) :]:
                file.add(preference)
        assert cut.read_bytes() == whole, size


def test_one_process_at_a_time_adds_to_a_file(path: Path) -> None:
    before = path.read_bytes()
    with PreferenceFile(path, LENGTHS), pytest.raises(InvalidValueError, match="another process"):
        PreferenceFile(path, LENGTHS)
    assert path.read_bytes() == before


def test_what_was_added_survives_a_kill(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of forking beside threads, of which this uses none
        child = os.fork()
    if child == 0:
        with PreferenceFile(tmp_path / "said.jsonl", LENGTHS) as file:
            file.add(SAID[0])
            os.kill(os.getpid(), signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    assert os.WTERMSIG(status) == signal.SIGKILL
    assert read_preferences(tmp_path / "said.jsonl") == SAID[:1]


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ("[]", "line 3 cannot be used"),
        ("{", "line 3 cannot be used"),
        ("[" * 5000, "line 3 cannot be used"),
        ('{"left": 1}', "line 3 cannot be used"),
        ('{"left": {"uid": 1, "first": 0, "length": 5}}', "is not a segment|'right'"),
        ("first=0.5", "is not a segment"),
        ("first=true", "is not a segment"),
        ("first=-1", "begins before its episode"),
        ("length=0", "no steps"),
        ("first=16", "episode a has 20 steps, and 21 are named"),
        ('uid="c"', "the dataset has no episode c: it was made for another one"),
        ("preferred=null", "preferred is None. Valid: left, right, equal"),
        ("preferred=[1]", "preferred is .*Valid: left, right, equal"),
    ],
)
def test_malformed_lines_are_named(path: Path, line: str, problem: str) -> None:
    lines = path.read_text().splitlines()
    if line[0] not in "[{":
        name, _, value = line.partition("=")
        tree = json.loads(lines[1])
        (tree if name in tree else tree["left"])[name] = json.loads(value)
        line = json.dumps(tree)
    path.write_text("\n".join([*lines[:2], line, *lines[2:]]) + "\n")
    with pytest.raises(DemoError, match=problem):
        read_preferences(path, LENGTHS)
    with pytest.raises(DemoError, match="line 3"):
        PreferenceFile(path, LENGTHS)


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "notes.jsonl"
    path.write_text('{"mine": 1}\n')
    with pytest.raises(DemoError, match="begins with"):
        read_preferences(path)
    with pytest.raises(InvalidValueError, match="was not written by aerial_il"):
        PreferenceFile(path, LENGTHS)
    assert path.read_text() == '{"mine": 1}\n'
    path.write_bytes(b"\xff\xfe" + json.dumps(HEADER).encode())
    with pytest.raises(DemoError, match="cannot be read"):
        read_preferences(path)
    with pytest.raises(DemoError, match=r"does not exist.*aerial-il prefer"):
        read_preferences(tmp_path / "none.jsonl")
    os.mkfifo(tmp_path / "pipe.jsonl")
    with pytest.raises(DemoError, match="not a regular file"):
        read_preferences(tmp_path / "pipe.jsonl")
