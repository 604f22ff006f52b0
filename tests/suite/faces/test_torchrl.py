"""TorchRL's own wrapper takes our Gymnasium environments, one world or many; it is not among what we install."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

import aerial_il

libs = pytest.importorskip("torchrl.envs", reason="TorchRL is not installed: python -m pip install torchrl")

ENV = "aerial_il/reach-ua_quad_arm4-v0"


def test_one_world_is_what_its_specifications_say() -> None:
    env = libs.GymWrapper(gymnasium.make(ENV))
    pytest.importorskip("torchrl.envs.utils").check_env_specs(env)
    fields = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=1).spec.observation.names
    assert set(fields) <= set(env.observation_spec.keys())


def test_its_flight_is_ours() -> None:
    env, ours = libs.GymWrapper(gymnasium.make(ENV)), gymnasium.make(ENV)
    env.set_seed(7)
    flown = env.rollout(5)
    ours.reset(seed=7)  # as set_seed does
    obs, _ = ours.reset()  # as rollout does
    for step, action in enumerate(flown["action"].numpy()):
        np.testing.assert_array_equal(flown["base_pos"][step].numpy(), obs["base_pos"])
        obs, reward, *_ = ours.step(action)
        np.testing.assert_allclose(flown["next", "reward"][step].item(), float(reward), rtol=1e-6)


@pytest.mark.parametrize("mode", ["SAME_STEP", "DISABLED"])
def test_many_worlds_are_a_batch(mode: str) -> None:
    """TorchRL takes no NEXT_STEP, our default."""
    worlds = gymnasium.make_vec(ENV, num_envs=3, vectorization_mode="vector_entry_point", autoreset_mode=mode)
    env = libs.GymWrapper(worlds)
    assert tuple(env.batch_size) == (3,)
    assert tuple(env.rollout(4).batch_size) == (3, 4)
