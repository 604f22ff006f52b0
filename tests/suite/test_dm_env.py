"""The single environment passes dm_env's own conformance test and is dm_control's own class."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from absl.testing import absltest
from dm_control.rl import control
from dm_env import StepType, test_utils

import aerial_il
from tests.contract.registered import CELLS, each_sample, single


class TestConformance(test_utils.EnvironmentTestMixin, absltest.TestCase):
    """dm_env's checks on the last cell, cut to half a second so that episodes end."""

    def make_object_under_test(self) -> control.Environment:
        env = aerial_il.load(*CELLS[-1], tier="gusts")
        env._step_limit = 25
        return env

    def make_action_sequence(self) -> Iterator[np.ndarray]:
        spec = self.environment.action_spec()
        rng = np.random.default_rng(0)
        for _ in range(40):
            yield rng.uniform(spec.minimum, spec.maximum)


class TestConformanceWithCameras(TestConformance):
    """The same with every kind of image among the observations."""

    pytestmark = pytest.mark.render

    def make_object_under_test(self) -> control.Environment:
        cameras = ("wrist", "scene:depth", "base:segmentation")
        env = aerial_il.load(*CELLS[0], cameras=cameras, image_size=(24, 32))
        env._step_limit = 8
        return env


@each_sample
def test_it_is_a_dm_control_environment(robot: str, task: str) -> None:
    env = single(robot, task)
    assert isinstance(env, control.Environment)
    assert env.control_timestep() == pytest.approx(env.spec.control_dt_s)
    assert env.physics.named.data.xpos["base"].shape == (3,)
    assert tuple(env.observation_spec()) == env.spec.observation.names


def test_resets_take_the_seeds_that_follow() -> None:
    env = aerial_il.load(*CELLS[0], seed=5)
    seeds = [int(env.simulation.seeds[0]) for _ in range(3) if env.reset()]
    env.reset(seed=40)
    assert seeds == [5, 6, 7]
    env.reset()
    assert env.simulation.seeds[0] == 41


def test_a_crash_ends_the_episode_with_discount_zero() -> None:
    env = single("ua_quad_arm4", "reach", "calm", "rotor")
    env.reset(seed=0)
    off = env.action_spec().minimum.copy()
    for _ in range(200):
        timestep = env.step(off)
        if timestep.last():
            break
    assert timestep.step_type is StepType.LAST
    assert timestep.discount == 0.0
    assert env.info["crash"]
    assert not env.info["success"]
    assert env.step(off).first()
