"""Conditions are read as Python and never run; what is refused is named."""

from pathlib import Path

import pytest

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.data.curation.selection import select
from aerial_il.data.curation.where import LONGEST, Where
from aerial_il.data.dataset import open_dataset

ROW = {"uid": "a", "success": True, "seconds": 4.5, "steps": 225, "operator": "ana", "return": 80.0, "score": None}
ORIGIN = {"settings": {"noise": 0.3, "deep": {"er": 2}}, "mujoco": "3.3", "phases": ["reach", "grasp"]}


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("success and length_s < 12 and operator == 'ana'", True),
        ("not success", False),
        ("success == true and score is null", True),
        ("3 < seconds <= 4.5", True),
        ("return > 79 and operator != 'return'", True),
        ("operator in ['ben', 'ana'] and 'an' in operator", True),
        ("operator not in ('ben',)", True),
        ("return / steps * 50 > 17 and -steps + 226 == 1 and steps % 2 == 1 and steps // 2 == 112", True),
        ("settings['noise'] > 0.2 and settings['deep']['er'] == 2", True),
        ("settings['none'] == 1 or settings['none']['deeper'] == 1", False),
        ("'grasp' in phases and mujoco == '3.3'", True),
        ("score > 1 or score < 1 or score + 1 > 0", False),
        ("-score < 0 or +score > 0 or score in operator", False),
        ("score not in operator", True),
        ("seconds > 1 or steps > 'text'", True),
    ],
)
def test_a_condition_holds_or_not(text: str, holds: bool) -> None:
    where = Where.parse(text)
    where.require(ROW, ORIGIN)
    assert where.holds(ROW, ORIGIN) is holds


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "success.__class__",
        "().__class__.__bases__",
        "open('x')",
        "9**9**9 > 1",
        "1 << 99999999",
        "[x for x in uid]",
        "(lambda: 1)()",
        "f'{uid}'",
        "uid[0] == 'a'",
        "settings[uid] == 1",
        "success if steps else success",
        "(x := 1) == 1",
        "~steps == 1",
        "{1: 2}",
        "uid == b'a'",
        "",
        "success and",
        "success; success",
        "steps = 3",
        "a" * (LONGEST + 1),
        "(" * 900 + "success" + ")" * 900,
        "not " * 400 + "success",
        "-" * 1900 + "1 == 1",
    ],
)
def test_what_is_no_condition_is_refused(text: str) -> None:
    with pytest.raises(InvalidValueError, match="where="):
        Where.parse(text)


@pytest.mark.parametrize(
    "text", ["steps + 1", "uid", "uid * 9", "'a' * 999999999 == uid", "steps < uid", "steps / 0 > 1"]
)
def test_what_cannot_be_said_of_a_row_is_refused(text: str) -> None:
    with pytest.raises(InvalidValueError, match="where="):
        Where.parse(text).holds(ROW, ORIGIN)


@pytest.mark.parametrize(
    ("text", "said"),
    [("lenght_s < 3", "lenght_s.*seconds"), ("packages['numpy'] == 1", "mapping 'packages'.*settings")],
)
def test_an_unknown_name_is_named_with_the_valid_ones(text: str, said: str) -> None:
    with pytest.raises(UnknownNameError, match=said):
        Where.parse(text).require(ROW, ORIGIN)


def test_flights_without_a_note_can_be_asked_for_their_note(dataset: Path) -> None:
    assert len(select(open_dataset(dataset, failures=True), "'pressed with' not in note")) == 12
    with pytest.raises(InvalidValueError, match="holds for none of 12"):
        select(open_dataset(dataset, failures=True), "'pressed with' in note")
