"""The base of ``ua_quad_arm4`` alone, for studies of flight control: it is its own tool, and grasps nothing."""

from __future__ import annotations

from aerial_il.robots import ua_quad_arm4
from aerial_il.robots.parts.arm import Arm
from aerial_il.robots.parts.gripper import NO_GRIPPER
from aerial_il.robots.robot import Robot

ROBOT = Robot(
    name="quad",
    summary="The bare quadrotor of ua_quad_arm4 (1.9 kg), without arm and gripper.",
    base=ua_quad_arm4.ROBOT.base,
    arm=Arm(),
    gripper=NO_GRIPPER,
    rest_forward=(),
    rest_down=(),
)
