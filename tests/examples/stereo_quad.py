"""A bare quadrotor that looks ahead with two eyes 12 cm apart, and down with a third."""

from aerial_il.robots import quad
from aerial_il.robots.parts.arm import Arm
from aerial_il.robots.parts.camera import AHEAD, DOWN, Camera
from aerial_il.robots.parts.gripper import NO_GRIPPER
from aerial_il.robots.robot import Robot

NOSE_M, HALF_BASELINE_M, BELLY_M = 0.09, 0.06, -0.04

ROBOT = Robot(
    name="stereo_quad",
    summary="A bare quadrotor (1.9 kg) with a stereo rig and a camera that looks down.",
    base=quad.ROBOT.base,
    arm=Arm(),
    gripper=NO_GRIPPER,
    rest_forward=(),
    rest_down=(),
    cameras=(
        Camera("left", "base", (NOSE_M, HALF_BASELINE_M, 0.0), AHEAD, fov=60.0, size=(96, 128)),
        Camera("right", "base", (NOSE_M, -HALF_BASELINE_M, 0.0), AHEAD, fov=60.0, size=(96, 128)),
        Camera("down", "base", (0.0, 0.0, BELLY_M), DOWN, up=AHEAD),
    ),
)
