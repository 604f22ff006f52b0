"""The single environment in processes, as Gymnasium and Stable-Baselines3 vectorise it."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import gymnasium
import numpy as np

from aerial_il.suite.faces.gymnasium_ids import gymnasium_id
from experiments.common.stopwatch import Arm

HAS_SB3 = importlib.util.find_spec("stable_baselines3") is not None


@contextmanager
def process_arms(robot: str, task: str, count: int, seed: int, actions: np.ndarray) -> Iterator[dict[str, Arm]]:
    """Both libraries' vectorised environments, their processes up as long as the context lasts.

    Args:
        robot, task: the cell. count: processes, one environment each; 0 gives none. seed: of the first environment.
        actions: (T, n, Da) to fly, n at least ``count``.

    Yields:
        name of the library -> arm that flies the actions; without Stable-Baselines3 only Gymnasium.
    """
    if count == 0:
        yield {}
        return
    make: Any = partial(gymnasium.make, f"aerial_il:{gymnasium_id(robot, task)}", disable_env_checker=True)
    mine = actions[:, :count].astype(np.float32)
    # "spawn": threads are running by now, forking would be unsafe
    vector = gymnasium.vector.AsyncVectorEnv([make] * count, context="spawn")
    arms = {"gymnasium": _arm(vector.step, lambda: vector.reset(seed=seed), mine)}
    closers: list[Callable[[], object]] = [vector.close]
    try:
        if HAS_SB3:
            from stable_baselines3.common.vec_env import SubprocVecEnv

            others = SubprocVecEnv([make] * count, start_method="spawn")
            closers.append(others.close)
            arms["sb3"] = _arm(others.step, others.reset, mine)
        yield arms
    finally:
        for close in closers:
            close()


def _arm(step: Callable[[np.ndarray], object], reset: Callable[[], object], actions: np.ndarray) -> Arm:
    def fly() -> None:
        for action in actions:
            step(action)

    return Arm(fly, units=actions.shape[0] * actions.shape[1], prepare=reset)
