"""Pose and twist of a base that moves."""

from __future__ import annotations

from dataclasses import dataclass

from aerial_il.control.dynamics import put, vec
from aerial_il.core.kernels import kernel
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.native import doubles
from aerial_il.suite.physics.world import base_mat, base_pos, put_rot6d
from aerial_il.suite.sensors.sensor import ESTIMATED, ROT6D, XYZ, Sensor


@dataclass(frozen=True)
class Base(Sensor):
    """Where the hub is, and how it moves."""

    def fields(self, robot: Robot) -> tuple[Field, ...]:
        if robot.fixed:
            return ()
        where, turned = "position of the hub", "first two columns of the rotation matrix"
        vel, spin = "velocity of the hub", "angular velocity of the hub"
        return (
            Field("base_pos", (3,), unit="m", labels=XYZ, frame="world", meaning=where, noise=ESTIMATED),
            Field("base_rot6d", (6,), labels=ROT6D, frame="world from base", meaning=turned, noise=ESTIMATED),
            Field("base_vel", (3,), unit="m/s", labels=XYZ, frame="world", meaning=vel, noise=ESTIMATED),
            Field("base_angvel", (3,), unit="rad/s", labels=XYZ, frame="base", meaning=spin, noise=ESTIMATED),
        )


@kernel
def read(own, world, seen, found):
    twist = doubles(seen.qvel, 6)
    put(found, 0, base_pos(seen))
    put_rot6d(found, 3, base_mat(seen))
    put(found, 9, vec(twist, 0))
    put(found, 12, vec(twist, 3))
