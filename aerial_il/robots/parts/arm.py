"""A serial arm of revolute joints with torque-limited position servos."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import NOTHING, ROBOT

Vector = tuple[float, float, float]
Colour = tuple[float, float, float, float]

GRAPHITE: Colour = (0.25, 0.27, 0.30, 1.0)
ORANGE: Colour = (0.93, 0.60, 0.20, 1.0)
SHORTEST_M = 0.01  # a link with its next joint at its own is drawn this long


@dataclass(frozen=True)
class Link:
    """One joint and the link it moves, whose frame is aligned with the base's when every joint is at zero.

    Attributes:
        axis: unit vector of the joint. tip: where the next joint, or the gripper, sits; m, from this joint.
        radius: m. mass: kg.
        limits: rad. speed: rad/s. torque: N m, the servo's limit.
        stiffness, damping: servo gains, N m/rad and N m s/rad. armature: reflected rotor inertia, kg m².
    """

    axis: Vector
    tip: Vector
    radius: float
    mass: float
    limits: tuple[float, float]
    speed: float
    torque: float
    stiffness: float
    damping: float
    armature: float

    @property
    def length(self) -> float:
        """Distance from this joint to the next, m."""
        return float(np.hypot(np.hypot(self.tip[0], self.tip[1]), self.tip[2]))

    @property
    def com(self) -> Vector:
        """Centre of mass in the link frame, m."""
        x, y, z = self.tip
        return (0.5 * x, 0.5 * y, 0.5 * z)

    @property
    def inertia(self) -> Vector:
        """Moments of inertia of a solid cylinder from joint to joint, about its centre and the link's axes, kg m².

        A cylinder at a slant to the axes has products of inertia too; they are left out, of the simulated link as
        much as of the nominal one.
        """
        across = self.mass * (3 * self.radius**2 + self.length**2) / 12
        along = 0.5 * self.mass * self.radius**2
        share = np.square(self.tip) / self.length**2 if self.length else np.zeros(3)
        x, y, z = across + (along - across) * share
        return (float(x), float(y), float(z))

    def add_inertia(self, body: mujoco.MjsBody) -> None:
        """Give the simulated body the link's mass, centre of mass and inertia."""
        body.mass, body.ipos, body.inertia, body.explicitinertial = self.mass, self.com, self.inertia, True

    def add_shapes(self, spec: mujoco.MjSpec, body: mujoco.MjsBody, i: int, colour: Colour) -> None:
        """Add the geoms of link ``i`` to its body: what it collides with and looks like, without mass."""
        capsule, sphere = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_SPHERE
        tip = np.array(self.tip) * max(1.0, SHORTEST_M / self.length) if self.length else (SHORTEST_M, 0.0, 0.0)
        look = {"size": [self.radius, 0, 0], "rgba": colour, "mass": 0}
        body.add_geom(name=f"link_{i}", type=capsule, fromto=[0, 0, 0, *tip], **look, **ROBOT)
        look = {"size": [1.3 * self.radius, 0, 0], "rgba": GRAPHITE, "mass": 0}
        body.add_geom(name=f"elbow_{i}", type=sphere, **look, **NOTHING)


@dataclass(frozen=True)
class Arm:
    """A chain of links, base to tip; a base without an arm has no links.

    Attributes:
        links: each begins at the tip of the one before. mount: where the first joint sits on the base, m.
        colours: of even and of odd links.
    """

    links: tuple[Link, ...] = ()
    mount: Vector = (0.0, 0.0, 0.0)
    colours: tuple[Colour, Colour] = (GRAPHITE, ORANGE)

    @cached_property
    def reach(self) -> float:
        """Length of the outstretched arm, m."""
        return sum(link.length for link in self.links)

    @property
    def offsets(self) -> tuple[Vector, ...]:
        """Position of each joint in the frame of the link, or base, that carries it, m."""
        return (self.mount, *(link.tip for link in self.links))[: len(self.links)]

    @property
    def tip(self) -> Vector:
        """Seat of the gripper in the last link's frame, m."""
        return self.links[-1].tip if self.links else self.mount

    def add_to(self, spec: mujoco.MjSpec, base: mujoco.MjsBody) -> mujoco.MjsBody:
        """Hang bodies ``link_0`` … with joints and servos ``joint_0`` … from ``base``; return the last body."""
        body = base
        for i, (link, offset) in enumerate(zip(self.links, self.offsets, strict=True)):
            body = self._add_link(spec, body, i, link, offset)
        return body

    def _add_link(
        self, spec: mujoco.MjSpec, parent: mujoco.MjsBody, i: int, link: Link, offset: Vector
    ) -> mujoco.MjsBody:
        body = parent.add_body(name=f"link_{i}", pos=offset)
        link.add_inertia(body)
        body.add_joint(
            name=f"joint_{i}", axis=link.axis, range=link.limits, limited=True, armature=link.armature, damping=0.01
        )
        link.add_shapes(spec, body, i, self.colours[i % 2])
        servo = spec.add_actuator(name=f"joint_{i}", target=f"joint_{i}", trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=link.stiffness, kv=link.damping)
        servo.forcelimited, servo.forcerange = True, [-link.torque, link.torque]
        return body
