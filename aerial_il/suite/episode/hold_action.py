"""The command that keeps one world's robot where it is, at any action level."""

from __future__ import annotations

import numpy as np

from aerial_il.control.actions import hover_action
from aerial_il.suite.physics.view import View
from aerial_il.suite.scenario import Scenario


def hold_action(scenario: Scenario, view: View, world: int) -> np.ndarray:
    """Return the action (Da,) that holds the present pose of ``world``, read off its state."""
    base = view.base_mat[world]
    return hover_action(
        scenario.level,
        scenario.robot.vehicle,
        view.tool_pos[world],
        view.tool_rot6d[world],
        base_pos=view.base_pos[world],
        yaw=float(np.arctan2(base[3], base[0])),
    )
