"""A serial arm of revolute joints with torque-limited position servos."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from aerial_il.robots.parts.collision import NOTHING, ROBOT

LINK_COLOURS = ([0.25, 0.27, 0.30, 1.0], [0.93, 0.60, 0.20, 1.0])


@dataclass(frozen=True)
class Link:
    """One joint and the link it moves. The link lies along +x of its own frame when the joint is at zero.

    Attributes:
        axis: joint axis in the parent's frame. offset: joint position in the parent's frame, m.
        length: m. radius: m. mass: kg.
        limits: rad. speed: rad/s. torque: N m, the servo's limit.
        stiffness, damping: servo gains, N m/rad and N m s/rad. armature: reflected rotor inertia, kg m².
    """

    axis: tuple[float, float, float]
    offset: tuple[float, float, float]
    length: float
    radius: float
    mass: float
    limits: tuple[float, float]
    speed: float
    torque: float
    stiffness: float
    damping: float
    armature: float

    @property
    def com(self) -> tuple[float, float, float]:
        """Centre of mass in the link frame, m."""
        return (0.5 * self.length, 0.0, 0.0)

    @property
    def inertia(self) -> tuple[float, float, float]:
        """Diagonal inertia of a solid cylinder along x about its centre, kg m²."""
        across = self.mass * (3 * self.radius**2 + self.length**2) / 12
        return (0.5 * self.mass * self.radius**2, across, across)


@dataclass(frozen=True)
class Arm:
    """A chain of links, base to tip. ``mount``: position of the first joint is its own offset from the base, m."""

    links: tuple[Link, ...]

    @property
    def reach(self) -> float:
        """Length of the outstretched arm, m."""
        return sum(link.length for link in self.links)

    def add_to(self, spec: mujoco.MjSpec, base: mujoco.MjsBody) -> mujoco.MjsBody:
        """Hang bodies ``link_0`` … with joints and servos ``joint_0`` … from ``base``; return the last body."""
        body = base
        for i, link in enumerate(self.links):
            body = self._add_link(spec, body, i, link)
        return body

    def _add_link(self, spec: mujoco.MjSpec, parent: mujoco.MjsBody, i: int, link: Link) -> mujoco.MjsBody:
        body = parent.add_body(
            name=f"link_{i}",
            pos=link.offset,
            mass=link.mass,
            ipos=link.com,
            inertia=link.inertia,
            explicitinertial=True,
        )
        body.add_joint(
            name=f"joint_{i}", axis=link.axis, range=link.limits, limited=True, armature=link.armature, damping=0.01
        )
        capsule, sphere = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_SPHERE
        tip = [max(link.length, 0.01), 0.0, 0.0]
        look = {"size": [link.radius, 0, 0], "rgba": LINK_COLOURS[i % 2], "mass": 0}
        body.add_geom(name=f"link_{i}", type=capsule, fromto=[0, 0, 0, *tip], **look, **ROBOT)
        look = {"size": [1.3 * link.radius, 0, 0], "rgba": LINK_COLOURS[0], "mass": 0}
        body.add_geom(name=f"elbow_{i}", type=sphere, **look, **NOTHING)
        servo = spec.add_actuator(name=f"joint_{i}", target=f"joint_{i}", trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=link.stiffness, kv=link.damping)
        servo.forcelimited, servo.forcerange = True, [-link.torque, link.torque]
        return body
