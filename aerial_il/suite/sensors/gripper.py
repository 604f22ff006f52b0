"""Opening of the gripper."""

from __future__ import annotations

from dataclasses import dataclass

from aerial_il.core.kernels import kernel
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.world import gripper_opening
from aerial_il.suite.sensors.sensor import ENCODED, Sensor


@dataclass(frozen=True)
class Gripper(Sensor):
    """How far the fingers are apart."""

    def fields(self, robot: Robot) -> tuple[Field, ...]:
        meaning = "opening of the gripper: 0 closed, 1 open"
        return (Field("gripper", (1,), labels=("opening",), meaning=meaning, noise=ENCODED),) * robot.has_gripper


@kernel
def read(own, world, seen, found):
    found[0] = gripper_opening(seen)
