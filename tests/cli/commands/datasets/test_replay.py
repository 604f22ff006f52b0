"""Recordings are flown again in the environment that they say, or the reason why not is said."""

from pathlib import Path

import pytest

from aerial_il.cli.main import main

QUIET = "progress=false"


def test_flights_over_a_horizon_replay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flown = str(tmp_path / "flown")
    assert main(["collect", "robot=quad", "task=hover", "episodes=1", "horizon=30", f"out={flown}", QUIET]) == 0
    assert main(["replay", flown, "starts=[0,20]", QUIET]) == 0
    assert "1 episodes, 40 steps flown again, every bit equal." in capsys.readouterr().out


def test_an_external_environment_without_states_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["env=gymnasium:CartPole-v1", "policy=random", "success=survived", "max_steps=3", "episodes=1"]
    assert main(["collect", *words, f"out={tmp_path}", QUIET]) == 0
    assert main(["replay", str(tmp_path), QUIET]) == 2
    assert "holds no simulator states" in capsys.readouterr().err
