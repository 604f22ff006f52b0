"""What cameras of a batch show is each world as it stands, whichever of them moved."""

from __future__ import annotations

import gc

import gymnasium
import numpy as np
import pytest

import aerial_il
from aerial_il.suite.batch import BatchEnvironment
from tests.contract.registered import CELLS

pytestmark = pytest.mark.render


def same(shown: dict[str, np.ndarray], env: BatchEnvironment) -> None:
    """Compare images with those of a look at all worlds."""
    anew = env.observe()
    for key in ("wrist_rgb", "base_depth"):
        np.testing.assert_array_equal(shown[key], anew[key])


def test_images_are_of_the_worlds_as_they_stand() -> None:
    env = aerial_il.load_batch(*CELLS[0], num_envs=3, cameras=("wrist", "base:depth"), image_size=(24, 32))
    try:
        first = env.reset(0)
        same(first, env)
        some = np.array([True, False, True])
        action = np.tile(env.spec.action.clip(np.full(env.spec.action.size, 0.4)), (3, 1))
        for _ in range(10):
            moved = env.step(action, some).obs
        same(moved, env)
        changed = [not np.array_equal(a, b) for a, b in zip(first["wrist_rgb"], moved["wrist_rgb"], strict=True)]
        assert changed == some.tolist()
        same(env.reset(7, ~some), env)
        same(env.set_state(np.roll(env.get_state(), 1, axis=0), some), env)
        assert (first["wrist_rgb"] != env.observe()["wrist_rgb"]).any(), "what was handed out is not written again"
    finally:
        env.close()


def test_a_forgotten_environment_spoils_no_images() -> None:
    def shown() -> tuple[BatchEnvironment, np.ndarray]:
        env = aerial_il.load_batch(*CELLS[0], num_envs=2, cameras=("wrist",), image_size=(24, 32))
        return env, env.reset(0)["wrist_rgb"]

    forgotten, first = shown()
    env, again = shown()
    try:
        np.testing.assert_array_equal(first, again)
        del forgotten
        gc.collect()
        np.testing.assert_array_equal(first, env.reset(0)["wrist_rgb"])
    finally:
        env.close()


def test_a_world_that_starts_by_itself_shows_its_new_episode() -> None:
    robot, task = CELLS[0]
    options = {"cameras": ("wrist", "base:depth"), "image_size": (24, 32), "max_episode_steps": 2}
    make = {"num_envs": 2, "vectorization_mode": "vector_entry_point", **options}
    vector = gymnasium.make_vec(f"aerial_il/{task}-{robot}-v0", **make)
    try:
        first, _ = vector.reset(seed=3)
        same(first, vector.unwrapped.aerial)
        still = np.zeros((2, vector.unwrapped.aerial.spec.action.size))
        for _ in range(2):
            _, _, _, truncated, _ = vector.step(still)
        assert truncated.all()
        again, *_ = vector.step(still)
        same(again, vector.unwrapped.aerial)
        assert (first["wrist_rgb"] != again["wrist_rgb"]).any()
    finally:
        vector.close()
