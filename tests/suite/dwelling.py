"""What the tasks with a hinge share: success waits for the dwell, and ends when the hinge goes back."""

from __future__ import annotations

import numpy as np

from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.tasks.task import Task
from tests.contract.registered import hold_actions


def check_dwell(worlds: BatchEnvironment, task: type[Task], joint: str, angles: np.ndarray) -> None:
    """Put the hinge of three worlds at ``angles`` (3,), rad: solved in the first two, just not in the last."""
    worlds.reset(0)
    angle, _ = worlds.simulation.view.joint(joint)
    hover = hold_actions(worlds)
    dwell = round(task.dwell_s / worlds.spec.control_dt_s)

    angle[:] = angles
    worlds.set_state(worlds.get_state())
    seen = [worlds.step(hover).info["success"] for _ in range(dwell)]
    assert not np.any(seen[:-1])
    assert seen[-1].tolist() == [True, True, False]

    angle[:] = 0.0
    worlds.set_state(worlds.get_state())
    assert not worlds.step(hover).info["success"].any()
