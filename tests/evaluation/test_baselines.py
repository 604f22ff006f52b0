"""Baselines fly every robot at every action level, alike in any batch, and solve nothing."""

from __future__ import annotations

import numpy as np
import pytest

import aerial_il
from aerial_il.core.contracts import attach
from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation.baselines import BASELINES
from aerial_il.evaluation.rollouts import rollouts


@pytest.mark.parametrize("name", BASELINES)
def test_an_episode_does_not_depend_on_those_beside_it(name: str) -> None:
    flown = {}
    for worlds in (1, 3):
        env = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=worlds, num_threads=1)
        for trace in rollouts(env, BASELINES[name](), [5, 6]):
            flown.setdefault(trace.seed, []).append(trace)
        env.close()
    for first, second in flown.values():
        np.testing.assert_array_equal(first.actions, second.actions)
        assert not first.success


@pytest.mark.parametrize("level", ["ee_pose", "base_joint", "velocity"])
def test_hovering_stays_where_it_began(level: str) -> None:
    env = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=2, action=level, num_threads=1)
    policy = attach(BASELINES["hover"](), env)
    obs = env.reset(3)
    policy.reset()
    start = obs["base_pos"].copy()
    for _ in range(100):
        obs = env.step(policy.act(obs)).obs
    assert np.abs(obs["base_pos"] - start).max() < 0.15
    env.close()


@pytest.mark.parametrize("name", BASELINES)
def test_a_baseline_asks_to_be_attached(name: str) -> None:
    with pytest.raises(InvalidValueError, match="attach"):
        BASELINES[name]().act({})
