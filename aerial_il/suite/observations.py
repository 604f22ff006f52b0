"""What every robot knows of itself."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.view import View

_XYZ = ("x", "y", "z")
_ROT6D = ("xx", "xy", "xz", "yx", "yy", "yz")


def robot_fields(robot: Robot) -> tuple[Field, ...]:
    """Fields of :func:`observe_robot`: of a base that moves, of an arm, of a gripper, as far as the robot has them."""
    joints = tuple(str(i) for i in range(robot.num_joints))
    base = (
        Field("base_pos", (3,), unit="m", labels=_XYZ),
        Field("base_rot6d", (6,), labels=_ROT6D),
        Field("base_vel", (3,), unit="m/s", labels=_XYZ),
        Field("base_angvel", (3,), unit="rad/s", labels=_XYZ),
    )
    arm = (
        Field("joint_pos", (robot.num_joints,), unit="rad", labels=joints),
        Field("joint_vel", (robot.num_joints,), unit="rad/s", labels=joints),
    )
    gripper = (Field("gripper", (1,), labels=("opening",)),)
    tool = (Field("ee_pos", (3,), unit="m", labels=_XYZ), Field("ee_rot6d", (6,), labels=_ROT6D))
    parts = ((not robot.fixed, base), (bool(joints), arm), (robot.has_gripper, gripper), (True, tool))
    return tuple(field for there, fields in parts if there for field in fields)


def observe_robot(view: View, names: Iterable[str]) -> dict[str, np.ndarray]:
    """Proprioception ``name -> (n, ...)``: poses and base velocity in the world frame, body rates in the base's.

    Args:
        view: the worlds. names: of the fields wanted, see :func:`robot_fields`.
    """
    return {name: _READINGS[name](view) for name in names}


_READINGS: dict[str, Callable[[View], np.ndarray]] = {
    "base_pos": lambda view: view.base_pos.copy(),
    "base_rot6d": lambda view: view.base_rot6d,
    "base_vel": lambda view: view.base_vel.copy(),
    "base_angvel": lambda view: view.base_angvel.copy(),
    "joint_pos": lambda view: view.joint_pos.copy(),
    "joint_vel": lambda view: view.joint_vel.copy(),
    "gripper": lambda view: view.gripper,
    "ee_pos": lambda view: view.tool_pos.copy(),
    "ee_rot6d": lambda view: view.tool_rot6d,
}
