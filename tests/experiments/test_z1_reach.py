"""The study of reaching with a fixed arm: what it compares, how it tells shaking, and what it asks for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.algorithms.sac import SAC
from aerial_il.core.composition import build
from aerial_il.core.contracts import Observation
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from experiments.common.record import Record
from experiments.z1_reach.holding import held, hold
from experiments.z1_reach.study import Arm, Z1Reach

HINDSIGHT = build(SAC, {"hindsight": {"goals": 4}})
STUDY = Z1Reach(seeds=2, sac=HINDSIGHT, smooth=replace(SAC().smoothness, temporal=1.0))


def test_every_algorithm_is_tried_everywhere() -> None:
    arms = STUDY.arms()
    assert len(arms) == len(set(arms)) == 3 * 2 * 2 + 3
    for arm in (arm for arm in arms if arm.smooth):
        plain = replace(arm, smooth=False)
        assert plain in arms
        assert replace(STUDY.learner(arm), smoothness=SAC().smoothness) == STUDY.learner(plain)
        assert STUDY.learner(arm).smoothness.temporal == 1.0


def test_what_the_targets_ask_for_is_trained_first() -> None:
    trainings = STUDY.trainings()
    assert len(trainings) == 2 * 2 + 13, "and all others once"
    assert {(arm.action, arm.reward, arm.algorithm) for arm, _ in trainings[:4]} == {("velocity", "sparse", "sac")}
    assert [seed for _, seed in trainings[:4]] == [0, 0, 1, 1]


def test_hindsight_is_for_the_sparse_reward() -> None:
    assert STUDY.learner(Arm("velocity", "sparse", "sac", False)).hindsight.goals == 4
    assert STUDY.learner(Arm("velocity", "dense", "sac", False)).hindsight.goals == 0


def test_unknown_algorithms_are_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"algorithms names \['ppo'\]; valid: sac, td3, ddpg"):
        Z1Reach(algorithms=("ppo",))


def test_swinging_is_told_from_resting_and_drifting() -> None:
    steps = np.arange(100)
    swings, rests, drifts = (-1.0) ** steps, np.zeros(100), steps / 100
    found = held(np.stack([swings, rests, drifts], 1)[:, None], np.full((100, 1), 0.01), 0.02)
    each = [held(values[:, None, None], np.full((100, 1), 0.01), 0.02) for values in (swings, rests, drifts)]
    assert [one.reversals_hz for one in each] == [50.0, 0.0, 0.0]
    assert [one.change for one in each] == [2.0, 0.0, 0.01]
    assert found.away_cm == 1.0


class Shaking:
    """Swings the joints to and fro about rest."""

    def __init__(self, amplitude: float) -> None:
        self.amplitude, self.step = amplitude, 0

    def reset(self, mask: np.ndarray | None = None) -> None:
        self.step = 0

    def act(self, obs: Observation) -> np.ndarray:
        self.step += 1
        actions = np.full((len(obs["joint_pos"]), 7), self.amplitude * (-1) ** self.step)
        actions[:, -1] = self.step % 2  # the gripper, which is left out
        return actions


def test_holding_is_of_the_arm_alone() -> None:
    env = aerial_il.load_batch("z1", "reach", num_envs=2, action="velocity", horizon=20, num_threads=1)
    try:
        still, shaken = (hold(env, Shaking(a), np.array([5000, 5001]), steps=20, watched=10) for a in (0.0, 0.31))
    finally:
        env.close()
    assert (still.change, still.reversals_hz) == (0.0, 0.0)
    assert shaken.change == pytest.approx(0.2)
    assert shaken.reversals_hz == 50.0


@pytest.mark.slow
def test_the_study_runs_and_what_is_there_is_not_done_again(tmp_path: Path) -> None:
    short = {"steps": 160, "warmup": 80, "replay": {"batch_size": 8}, "critics": {"hidden": (8,)}}
    short |= {"cadence": {"evaluate_every": 80}}
    study = Z1Reach(
        policy=SquashedGaussian(hidden=(8,)),
        sac=build(SAC, short),
        algorithms=("sac",),
        actions=("velocity",),
        rewards=("sparse",),
        seeds=2,
        horizon=20,
        num_envs=2,
        episodes=2,
        curve_episodes=2,
    )
    report = study.run(tmp_path, progress=False)
    rows = report.tables["Arms"]
    assert [(row["smooth"], row["trainings"], row["episodes"]) for row in rows] == [(True, 2, 4), (False, 2, 4)]
    assert len(report.tables["Single trainings"]) == 4
    assert [target.limit for target in report.targets] == [100.0, 0.5]
    assert "svg" in report.figures["z1_reach.svg"]
    arm = Arm("velocity", "sparse", "sac", False)
    judged = study.judged_place(arm, 1, Record(tmp_path)) / "evaluation.json"
    before = judged.stat().st_mtime_ns
    assert study.run(tmp_path, progress=False).tables == report.tables
    assert judged.stat().st_mtime_ns == before
