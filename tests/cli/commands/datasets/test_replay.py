"""Recordings are flown again in the environment that they say, or the reason why not is said."""

from pathlib import Path

import pytest

from aerial_il.cli.main import main
from aerial_il.data.dataset import open_dataset
from aerial_il.data.folder import FAILURES, DatasetFolder
from aerial_il.data.recording.reader import read_episode

QUIET = "progress=false"


def test_flights_over_a_horizon_replay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flown = str(tmp_path / "flown")
    assert main(["collect", "robot=quad", "task=hover", "episodes=1", "horizon=30", f"out={flown}", QUIET]) == 0
    assert main(["replay", flown, "starts=[0,20]", QUIET]) == 0
    assert "1 episodes, 40 steps flown again, every bit equal." in capsys.readouterr().out


def test_a_damaged_first_recording_is_neither_counted_nor_in_the_way(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flown = tmp_path / "flown"
    assert main(["collect", "robot=quad", "task=hover", "episodes=2", "horizon=30", f"out={flown}", QUIET]) == 0
    first, other = DatasetFolder(flown).files(FAILURES)
    raw = bytearray(first.read_bytes())
    raw[len(raw) // 2] ^= 0xFF
    first.write_bytes(raw)
    dataset = open_dataset(flown, failures=True)
    assert len(dataset) == 2
    assert dataset.spec == read_episode(other).spec
    assert main(["replay", str(flown), QUIET]) == 0
    assert "1 episodes, 30 steps flown again, every bit equal." in capsys.readouterr().out


def test_an_external_environment_without_states_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["env=gymnasium:CartPole-v1", "policy=random", "success=survived", "max_steps=3", "episodes=1"]
    assert main(["collect", *words, f"out={tmp_path}", QUIET]) == 0
    assert main(["replay", str(tmp_path), QUIET]) == 2
    assert "holds no simulator states" in capsys.readouterr().err
