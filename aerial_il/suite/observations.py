"""Observation fields of the robot itself: base, arm and gripper."""

from __future__ import annotations

from aerial_il.control.dynamics import put, vec
from aerial_il.core.kernels import kernel
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.native import doubles
from aerial_il.suite.physics.world import base_mat, base_pos, gripper_opening, put_rot6d, tool_mat, tool_pos

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


@kernel
def observe_robot(world, found):
    """Write what a robot knows of itself; the fields of :func:`robot_fields` in their order.

    Poses and base velocity are in the world frame, body rates in the base's.

    Args:
        world: a record. found: (D,) written.
    """
    k, qpos = 0, doubles(world.qpos, world.fingers + 2)
    if world.flies > 0.0:
        twist = doubles(world.qvel, 6)
        put(found, 0, base_pos(world))
        put_rot6d(found, 3, base_mat(world))
        put(found, 9, vec(twist, 0))
        put(found, 12, vec(twist, 3))
        k = 15
    joints = world.num_joints
    for j in range(joints):
        found[k + j] = qpos[world.first_joint + j]
        found[k + joints + j] = doubles(world.qvel + 8 * (world.first_dof + j), 1)[0]
    k += 2 * joints
    if world.grips > 0.0:
        found[k] = gripper_opening(world)
        k += 1
    put(found, k, tool_pos(world))
    put_rot6d(found, k + 3, tool_mat(world))
