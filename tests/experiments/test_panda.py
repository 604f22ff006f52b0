"""The study of panda-gym: what is trained how often, what can be missed, and what is said where it is not installed."""

from __future__ import annotations

from pathlib import Path

import pytest

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from experiments.panda import study as panda
from experiments.panda.study import PUSH, REACH, Arm, Panda, targets_of


def test_every_algorithm_is_trained_with_every_seed() -> None:
    planned = Panda(seeds=2, pushes=1).trainings()
    assert [arm for arm, seed in planned if seed == 1] == [Arm(REACH, name) for name in ("ddpg", "td3", "sac")]
    assert [seed for arm, seed in planned if arm == Arm(PUSH, "sac")] == [0]


def test_every_target_can_be_missed() -> None:
    def verdicts(worst: float, found: float) -> list[bool | None]:
        row = {"success": 1, "episodes": 1, "trainings": 1, "worst": worst, "return": found, "worst_return": found}
        return [target.met for target in targets_of({Arm(REACH, "sac"): row, Arm(PUSH, "sac"): row})]

    assert verdicts(100.0, -1.9) == [True, True, True]
    assert verdicts(99.5, -2.1) == [False, False, True]
    assert verdicts(94.5, -2.1) == [False, False, False]


def test_what_is_missing_or_unknown_is_answered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UnknownNameError, match="PandaReach-v3"):
        Panda(tasks=("PandaReach",))
    with pytest.raises(InvalidValueError, match="start at 1"):
        Panda(worlds=0)
    monkeypatch.setattr(panda, "find_spec", lambda name: None)
    report = Panda().run(tmp_path, progress=False)
    assert "pip install" in report.tables["Skipped"][0]["why"]
    assert report.targets == ()
