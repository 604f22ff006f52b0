"""Flights by which two commits of this package are compared: run as a script of its own in the process of each.

Only names that both have may be used here: those that ``aerial_il`` itself offers, and ``collect``.
"""

from __future__ import annotations

import tempfile
import time
from typing import Any

import numpy as np

import aerial_il

_environments: dict[tuple[str, str, int], Any] = {}


def knows(robot: str, task: str) -> bool:
    """Return whether there is such a cell."""
    return (robot, task) in aerial_il.list_cells()


def first(robot: str, task: str, num_envs: int, threads: int) -> float:
    """Return the seconds from nothing but the import to the end of a first control step, compilation included."""
    started = time.perf_counter()
    env = aerial_il.load_batch(robot, task, num_envs=num_envs, num_threads=threads)
    expert = aerial_il.expert(robot, task)
    expert.attach(env)
    obs = env.reset(0)
    expert.reset()
    env.step(expert.act(obs))
    took = time.perf_counter() - started
    env.close()
    return took


def flight(robot: str, task: str, num_envs: int, threads: int, seed: int, steps: int) -> dict[str, float]:
    """Fly the expert for some control steps of all worlds, each of which begins its next flight when one ends.

    Returns:
        ``flights``: control steps of all worlds per second, with resets and the expert; ``env``: of ``step`` alone.
    """
    env, expert = _environment(robot, task, num_envs, threads), aerial_il.expert(robot, task)
    started, stepping = time.perf_counter(), 0.0
    expert.attach(env)
    seeds = seed + np.arange(num_envs)
    obs = env.reset(seeds)
    expert.reset()
    for _ in range(steps):
        actions = expert.act(obs)
        before = time.perf_counter()
        result = env.step(actions)
        stepping += time.perf_counter() - before
        obs, over = result.obs, result.info["success"] | result.terminated | result.truncated
        if over.any():
            seeds = np.where(over, seeds + num_envs, seeds)
            obs = env.reset(seeds, over)
            expert.reset(over)
    total = time.perf_counter() - started
    return {"flights": steps * num_envs / total, "env": steps * num_envs / stepping}


def collected(robot: str, task: str, num_envs: int, threads: int, seed: int, episodes: int) -> float:
    """Return the demonstrations that the expert flies and records in a minute."""
    from aerial_il.collection.collect import collect

    env = _environment(robot, task, num_envs, threads)
    with tempfile.TemporaryDirectory(prefix="aerial_il-") as folder:
        started = time.perf_counter()
        found = collect(env, aerial_il.expert(robot, task), range(seed, seed + episodes), folder, progress=False)
        return 60.0 * len(found.demos) / (time.perf_counter() - started)


def done(robot: str, task: str) -> None:
    """Let go of a cell's worlds."""
    for key in [key for key in _environments if key[:2] == (robot, task)]:
        _environments.pop(key).close()


def _environment(robot: str, task: str, num_envs: int, threads: int) -> Any:
    key = (robot, task, num_envs)
    if key not in _environments:
        _environments[key] = aerial_il.load_batch(robot, task, num_envs=num_envs, num_threads=threads)
    return _environments[key]
