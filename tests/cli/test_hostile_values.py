"""No value of any key of any command ends in a traceback; keys and commands are found: new ones are tried too."""

from pathlib import Path

import pytest

from aerial_il.cli import commands
from tests.cli.hostile_values import VALUES, Case, answered, cases, every, typed

SHARE, MORE = 601, 17  # one case of so many: by default, and among the slow tests


def test_the_share_has_all_commands_and_values() -> None:
    assert {name for name, _, _ in cases()} == set(commands.names())
    assert len({name for name, _, _ in every(SHARE)}) > len(commands.names()) / 2
    assert {value for _, _, value in every(MORE)} == set(VALUES)


@pytest.mark.parametrize("case", every(SHARE), ids=lambda case: f"{case[0]}-{case[1]}-{VALUES.index(case[2])}")
def test_a_value_is_answered(case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert answered(*case)
    assert not (tmp_path / "owned").exists()


@pytest.mark.parametrize(
    "case",
    [
        ("info", "path", "x" * 5000),
        ("inspect", "beside", "\x00"),
        ("new", "into", "/proc/self/mem"),
        ("report", "result", "[]"),
        ("teleop", "size", "[10]"),
    ],
    ids=["long", "null", "in a file", "nothing", "one side"],
)
def test_a_value_that_was_not_answered_once_is_answered(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert answered(*case)


@pytest.mark.slow
@pytest.mark.parametrize("name", commands.names())
def test_more_values_are_answered(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    wrong = [case for case in every(MORE) if case[0] == name and not answered(*case)]
    assert wrong == []
    assert not (tmp_path / "owned").exists()


def test_a_command_that_did_not_answer_would_be_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(config: object) -> None:
        raise ZeroDivisionError

    monkeypatch.chdir(tmp_path)
    assert typed("info", "json", "true") == ["json=true", "path=nowhere"]
    monkeypatch.setattr("aerial_il.cli.commands.datasets.info.run", fail)
    with pytest.raises(ZeroDivisionError):
        answered("info", "json", "true")
