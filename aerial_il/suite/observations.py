"""What every robot knows of itself."""

from __future__ import annotations

import numpy as np

from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.view import View

_XYZ = ("x", "y", "z")
_ROT6D = ("xx", "xy", "xz", "yx", "yy", "yz")


def robot_fields(robot: Robot) -> tuple[Field, ...]:
    """Fields of :func:`observe_robot`."""
    joints = tuple(str(i) for i in range(robot.num_joints))
    return (
        Field("base_pos", (3,), unit="m", labels=_XYZ),
        Field("base_rot6d", (6,), labels=_ROT6D),
        Field("base_vel", (3,), unit="m/s", labels=_XYZ),
        Field("base_angvel", (3,), unit="rad/s", labels=_XYZ),
        Field("joint_pos", (robot.num_joints,), unit="rad", labels=joints),
        Field("joint_vel", (robot.num_joints,), unit="rad/s", labels=joints),
        Field("gripper", (1,), labels=("opening",)),
        Field("ee_pos", (3,), unit="m", labels=_XYZ),
        Field("ee_rot6d", (6,), labels=_ROT6D),
    )


def observe_robot(view: View) -> dict[str, np.ndarray]:
    """Proprioception ``name -> (n, ...)``: poses and base velocity in the world frame, body rates in the base's."""
    return {
        "base_pos": view.base_pos.copy(),
        "base_rot6d": view.base_rot6d,
        "base_vel": view.base_vel.copy(),
        "base_angvel": view.base_angvel.copy(),
        "joint_pos": view.joint_pos.copy(),
        "joint_vel": view.joint_vel.copy(),
        "gripper": view.gripper,
        "ee_pos": view.tool_pos.copy(),
        "ee_rot6d": view.tool_rot6d,
    }
