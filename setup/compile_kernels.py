"""Compile what flies ahead of time, so that nobody's first flight waits; `make setup` runs it."""

from __future__ import annotations

import sys
import time

import numpy as np

import aerial_il


def main() -> None:
    """Fly each task for two steps, with every disturbance, in a batch and alone."""
    started, robots = time.perf_counter(), dict[str, str]()
    for robot, task in aerial_il.list_cells():
        robots.setdefault(task, robot)
    for task, robot in robots.items():
        worlds = aerial_il.load_batch(robot, task, num_envs=2, tier="hard", num_threads=1)
        expert, obs = aerial_il.expert(robot, task), worlds.reset(0)
        expert.attach(worlds)
        for _ in range(2):
            obs = worlds.step(expert.act(obs)).obs
        worlds.set_state(worlds.get_state(), np.array([True, False]))
        worlds.close()
    env = aerial_il.load("quad", "hover")
    env.reset(seed=0)
    env.step(np.zeros(env.action_spec().shape))
    print(f"Compiled what flies in {time.perf_counter() - started:.0f} s.", file=sys.stderr)


if __name__ == "__main__":
    main()
