"""The study of reaching with a fixed arm: what it compares, how it tells shaking, and what it asks for."""

from dataclasses import replace

import numpy as np
import pytest

import aerial_il
from aerial_il.algorithms.sac import SAC
from aerial_il.core.composition import build
from aerial_il.core.contracts import Observation
from experiments.z1_reach.holding import held, hold
from experiments.z1_reach.study import Z1Reach

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


def test_swinging_is_told_from_resting_and_drifting() -> None:
    steps = np.arange(100)
    swings, rests, drifts = (-1.0) ** steps, np.zeros(100), steps / 100
    result = held(np.stack([swings, rests, drifts], 1)[:, None], np.full((100, 1), 0.01), 0.02)
    each = [held(values[:, None, None], np.full((100, 1), 0.01), 0.02) for values in (swings, rests, drifts)]
    assert [one.reversals_hz for one in each] == [50.0, 0.0, 0.0]
    assert [one.change for one in each] == [2.0, 0.0, 0.01]
    assert result.away_cm == 1.0


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
