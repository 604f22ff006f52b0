"""A batch answers a call without arguments, and names its observations as a single environment does."""

from __future__ import annotations

import numpy as np

import aerial_il


def test_a_reset_without_seeds_goes_on_with_the_next_ones() -> None:
    worlds, others = (aerial_il.load_batch("quad", "hover", num_envs=2, num_threads=1, seed=4) for _ in range(2))
    assert worlds.seeds.tolist() == [4, 5]
    seen, same = worlds.reset(), others.reset(6)
    assert worlds.seeds.tolist() == [6, 7]
    assert all(np.array_equal(seen[name], same[name]) for name in same)
    worlds.reset(mask=np.array([True, False]))
    assert worlds.seeds.tolist() == [8, 7]


def test_observations_have_one_name_everywhere() -> None:
    single = aerial_il.load("quad", "hover").reset()
    worlds = aerial_il.load_batch("quad", "hover", num_envs=2, num_threads=1)
    step = worlds.step(np.zeros((2, worlds.spec.action.size)))
    assert step.observation is step.obs
    assert set(step.observation) == set(single.observation)
