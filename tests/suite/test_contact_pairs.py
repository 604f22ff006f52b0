"""Pairs of geoms that are named in place of a search have the same contacts, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from aerial_il.suite.physics.physics_model import MOST_PAIRS
from tests.contract.registered import batch, single

WORLDS, STEPS = 12, 25


@pytest.mark.parametrize(
    ("robot", "task"), [("quad", "take_off"), ("fa_hexa_arm4", "reach"), ("floating_gripper", "press_button")]
)
def test_a_robot_thrown_to_the_ground_tumbles_alike(robot: str, task: str) -> None:
    worlds, env = batch(robot, task, num_envs=WORLDS), single(robot, task)
    assert 0 < worlds.simulation.worlds.model.npair <= MOST_PAIRS
    assert env.physics.model.npair == 0
    rng = np.random.default_rng(1)
    worlds.reset(0)
    states = worlds.get_state()
    quat = rng.standard_normal((WORLDS, 4))
    states[:, 3], states[:, 4:8] = rng.uniform(0.1, 0.3, WORLDS), quat / np.linalg.norm(quat, axis=1)[:, None]
    actions = worlds.spec.action.clip(rng.uniform(-1.0, 1.0, (STEPS, WORLDS, worlds.spec.action.size)))
    worlds.set_state(states)
    for action in actions:
        worlds.step(action)
    met = 0
    for world in range(WORLDS):
        env.reset(seed=world)
        env.set_state(states[world : world + 1])
        for action in actions[:, world]:
            env.simulation.advance(action[None])  # a step of the environment would end at the crash
            met += env.physics.data.ncon
        np.testing.assert_array_equal(env.get_state()[0], worlds.get_state()[world])
    assert met > WORLDS


def test_objects_and_drawn_friction_leave_the_search() -> None:
    for cell in (("fa_hexa_arm4", "pick_place"), ("fa_hexa_arm4", "reach", "hard")):
        assert batch(*cell).simulation.worlds.model.npair == 0
