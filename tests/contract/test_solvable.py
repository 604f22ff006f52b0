"""Each supported pair is solved by its expert, and by nothing that does not try."""

from __future__ import annotations

import numpy as np

import aerial_il
from aerial_il.suite.batch import BatchEnvironment
from tests.contract.registered import batch, each_cell, each_cell_and_tier, hold_actions, random_actions

FEWEST_OF_FOUR = {"hard": 3}  # 85 % are asked of the experts there


@each_cell_and_tier
def test_the_expert_solves_it(robot: str, task: str, tier: str) -> None:
    worlds = batch(robot, task, tier, num_envs=4)
    expert = aerial_il.expert(robot, task)
    expert.attach(worlds)
    obs = worlds.reset(20_000)
    expert.reset()
    solved, touched = np.zeros(4, bool), np.zeros(4, bool)
    for _ in range(worlds.spec.max_steps):
        result = worlds.step(expert.act(obs), ~solved)
        obs = result.obs
        touched |= result.info["crash"]
        solved |= result.info["success"]
        assert (result.reward[result.info["success"]] == 1.0).all()
        if solved.all():
            break
    assert solved.sum() >= FEWEST_OF_FOUR.get(tier, 4)
    assert not touched[solved].any()


@each_cell
def test_random_actions_do_not(robot: str, task: str) -> None:
    worlds = batch(robot, task)
    worlds.reset(50)
    for actions in random_actions(worlds.spec.action, 120, 3):
        assert not worlds.step(actions).info["success"].any()


@each_cell
def test_the_reward_prefers_the_expert(robot: str, task: str) -> None:
    def mean_reward(worlds: BatchEnvironment, with_expert: bool) -> float:
        expert = aerial_il.expert(robot, task)
        expert.attach(worlds)
        obs, total = worlds.reset(60), 0.0
        expert.reset()
        start = hold_actions(worlds)
        for _ in range(100):
            result = worlds.step(expert.act(obs) if with_expert else start)
            obs, total = result.obs, total + result.reward.mean()
        return total / 100

    worlds = batch(robot, task)
    assert mean_reward(worlds, with_expert=True) > 1.5 * mean_reward(worlds, with_expert=False)
