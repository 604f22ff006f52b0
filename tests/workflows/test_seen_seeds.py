"""Whoever judges a policy on the starts that it learned from is told so."""

from pathlib import Path

import pytest

from aerial_il.cli.main import main

QUIET = "progress=false"


def test_seeds_that_were_learned_from_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["collect", "robot=quad", "task=hover", "episodes=2", "seed=10001", "out=flown", QUIET]) == 0
    assert main(["train", "dataset=flown", "run=run", "algorithm.steps=2", "algorithm.batch_size=8", QUIET]) == 0
    asked = ["evaluate", "policy=run", "episodes=3", "videos=0", QUIET]
    assert main([*asked, "out=seen"]) == 0
    assert "2 of the 3 seeds, the first 10001, were flown in flown, which the policy learned" in capsys.readouterr().err
    assert main([*asked, "out=unseen", "seed=20000"]) == 0
    assert "seeds" not in capsys.readouterr().err


def test_flights_that_were_not_taken_are_not_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["collect", "robot=quad", "task=hover", "episodes=3", "seed=9999", "out=flown", QUIET]) == 0
    few = ["dataset.episodes=1", "algorithm.steps=2", "algorithm.batch_size=8", "algorithm.validation=0"]
    assert main(["train", "dataset=flown", *few, "run=run", QUIET]) == 0
    assert main(["evaluate", "policy=run", "episodes=2", "videos=0", "out=judged", QUIET]) == 0
    assert "seeds" not in capsys.readouterr().err
