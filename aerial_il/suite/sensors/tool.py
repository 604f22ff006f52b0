"""Pose of the tool."""

from __future__ import annotations

from dataclasses import dataclass

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.world import put_rot6d, tool_mat, tool_pos
from aerial_il.suite.sensors.sensor import ESTIMATED, ROT6D, XYZ, Sensor


@dataclass(frozen=True)
class Tool(Sensor):
    """Where the gripper is, or the hub without an arm."""

    def fields(self, robot: Robot) -> tuple[Field, ...]:
        pose = "first two columns of the rotation matrix"
        return (
            Field("ee_pos", (3,), unit="m", labels=XYZ, frame="world", meaning="position of the tool", noise=ESTIMATED),
            Field("ee_rot6d", (6,), labels=ROT6D, frame="world from tool", meaning=pose, noise=ESTIMATED),
        )


@kernel
def read(own, world, seen, found):
    put(found, 0, tool_pos(seen))
    put_rot6d(found, 3, tool_mat(seen))
