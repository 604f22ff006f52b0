"""How a flying robot holds its tool turned as asked: level, its base wherever the arm needs it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aerial_il.control.inverse_kinematics import rest_posture
from aerial_il.control.reference import yaw_and_pitch
from aerial_il.control.scratch import SCRATCH
from aerial_il.control.vehicle import alone
from aerial_il.control.whole_body import find_posture
from aerial_il.core.rotations import mat_from_yaw
from aerial_il.robots.robot import Robot

ROUNDS = 3  # in which the base follows what the arm cannot reach


class Poise(NamedTuple):
    """A posture at level hover.

    Attributes:
        joints: (J,) rad. base: (3,) m, the base's origin from the tool, world axes. missed_rad: by which the tool is
            turned otherwise than asked.
    """

    joints: np.ndarray
    base: np.ndarray
    missed_rad: float


def poised(robot: Robot, mat: np.ndarray) -> Poise:
    """Return the posture that brings the tool of a flying robot nearest to an orientation.

    Args:
        mat: (3, 3) world from tool.
    """
    turned = tuple(np.ravel(mat))
    yaw, pitch = yaw_and_pitch(turned)
    level, joints = mat_from_yaw(yaw), np.zeros(robot.num_joints)
    rest_posture(robot.record, pitch, joints, 0)
    base, workspace, missed = np.zeros(3), np.zeros(1, SCRATCH), 0.0
    vehicle = alone(robot.record)
    for _ in range(ROUNDS):
        base = -np.reshape(level, (3, 3)) @ robot.tool_at(joints)[0]
        _, missed = find_posture(vehicle, workspace, tuple(base), level, (0.0, 0.0, 0.0), turned, joints)
    return Poise(joints, -np.reshape(level, (3, 3)) @ robot.tool_at(joints)[0], missed)
