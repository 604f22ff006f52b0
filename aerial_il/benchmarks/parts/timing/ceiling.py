"""The upper bound on the speed of one environment: its physics with nothing around it."""

from __future__ import annotations

import numpy as np

import aerial_il
from aerial_il.benchmarks.parts.timing.stopwatch import Arm, interleave
from aerial_il.benchmarks.parts.timing.workload import RawPhysics, record


def physics_alone(robot: str, task: str, *, seed: int, steps: int, repetitions: int) -> float:
    """Return the control steps per second, median, of the bare engine on the very model that one world is flown with.

    It is fed with an expert's recorded flight and takes all of it in one call: no controller, no copies, no Python.
    """
    env = aerial_il.load_batch(robot, task, num_envs=1, num_threads=1)
    try:
        work = record(env, np.array([seed]), steps)
        raw = RawPhysics(env.simulation.worlds.model, work, 1)
        arm = Arm(raw.roll_out, units=work.world_steps, prepare=raw.rewind)
        return float(np.median(interleave({"physics": arm}, repetitions)["physics"]))
    finally:
        env.close()
