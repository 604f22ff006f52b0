"""Altimeter: a laser along the base's own vertical that measures the distance to level ground."""

from dataclasses import dataclass

from aerial_il.core.kernels import kernel
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.noise import gaussian
from aerial_il.suite.physics.world import base_mat, base_pos, seed, tick
from aerial_il.suite.sensors.sensor import Sensor


@dataclass(frozen=True)
class Altimeter(Sensor):
    """Distance to the ground along the base's downward axis.

    Attributes:
        reach: m, what it shows where it sees nothing. deviation: m, of its white noise, in every tier.
    """

    reach: float = 5.0
    deviation: float = 0.01

    def fields(self, robot: Robot) -> tuple[Field, ...]:
        meaning, noise = "distance to level ground, along the hub's downward axis", f"white, {self.deviation:g} m"
        return (Field("altimeter", (1,), unit="m", frame="base", meaning=meaning, noise=noise),)


@kernel
def read(own, world, seen, result):
    upright = base_mat(world)[8]  # the truth: it measures by itself, whatever the robot believes
    distance = base_pos(world)[2] / upright if upright > 0.0 else own.reach
    result[0] = min(own.reach, distance + own.deviation * gaussian(seed(world), tick(world), own.stream))
