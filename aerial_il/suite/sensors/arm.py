"""Encoders of the arm's joints."""

from __future__ import annotations

from dataclasses import dataclass

from aerial_il.core.kernels import kernel
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.native import doubles
from aerial_il.suite.sensors.sensor import ENCODED, Sensor


@dataclass(frozen=True)
class Arm(Sensor):
    """Positions and velocities of the joints."""

    def fields(self, robot: Robot) -> tuple[Field, ...]:
        if not robot.num_joints:
            return ()
        shape, joints = (robot.num_joints,), tuple(str(i) for i in range(robot.num_joints))
        where, rates = "positions of the arm's joints", "velocities of the arm's joints"
        return (
            Field("joint_pos", shape, unit="rad", labels=joints, frame="joints", meaning=where, noise=ENCODED),
            Field("joint_vel", shape, unit="rad/s", labels=joints, frame="joints", meaning=rates, noise=ENCODED),
        )


@kernel
def read(own, world, seen, found):
    joints = seen.num_joints
    pos = doubles(seen.qpos + 8 * seen.first_joint, joints)
    vel = doubles(seen.qvel + 8 * seen.first_dof, joints)
    for j in range(joints):
        found[j], found[joints + j] = pos[j], vel[j]
