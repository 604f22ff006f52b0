"""A dataset, a folder of them and a single file are judged alike."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from aerial_il.cli.main import main

QUIET = "progress=false"


@pytest.fixture
def demos(tmp_path: Path) -> Path:
    words = ["env=gymnasium:CartPole-v1", "policy=random", "success=survived", "max_steps=3", "episodes=2"]
    assert main(["collect", *words, f"out={tmp_path / 'all' / 'flown'}", QUIET]) == 0
    return tmp_path / "all" / "flown"


def test_a_sound_file_is_sound_wherever_it_lies(demos: Path, tmp_path: Path) -> None:
    file = next(demos.glob("demos/*.mcap"))
    away = Path(shutil.copy(file, tmp_path / "away.mcap"))
    for place in (file, away, demos, demos.parent):
        assert main(["validate", str(place), QUIET]) == 0


def test_a_sound_file_that_is_not_the_one_listed_is_told(demos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, other = sorted(demos.glob("demos/*.mcap"))
    shutil.copy(other, file)
    for place in (file, demos, demos.parent):
        assert main(["validate", str(place), QUIET]) == 2
        assert "differs from what the index lists" in capsys.readouterr().out
    assert main(["validate", str(other), QUIET]) == 0


def test_a_damaged_file_is_told(demos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = next(demos.glob("demos/*.mcap"))
    file.write_bytes(file.read_bytes()[:-100])
    assert main(["validate", str(file), QUIET]) == 2
    assert "aerial-il recover" in capsys.readouterr().err
