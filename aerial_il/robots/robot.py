"""A robot: parameters in SI units, from which both the simulated model and the controller's nominal model are built."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import mujoco
import numpy as np

from aerial_il.control.allocation import mixer_matrix, wrench_matrix
from aerial_il.control.vehicle import GRAVITY, Vehicle
from aerial_il.robots.parts.arm import Arm
from aerial_il.robots.parts.camera import look_along
from aerial_il.robots.parts.gripper import Gripper
from aerial_il.robots.parts.rotorcraft import Rotorcraft

Actuation = Literal["under", "full", "over"]
LATERAL_SHARE = 0.9  # of the sideways force at level hover that the controller uses before it tilts


@dataclass(frozen=True)
class Robot:
    """An aerial manipulator.

    Attributes:
        name: registry name.
        summary: one sentence for people.
        base: frame and rotors.
        arm: serial arm hung from the base.
        gripper: parallel gripper at the arm's end.
        rest_forward, rest_down: (J,) postures with the tool horizontal and pointing straight down, rad.
    """

    name: str
    summary: str
    base: Rotorcraft
    arm: Arm
    gripper: Gripper
    rest_forward: tuple[float, ...]
    rest_down: tuple[float, ...]

    @property
    def num_joints(self) -> int:
        return len(self.arm.links)

    @property
    def num_rotors(self) -> int:
        return len(self.base.rotor_pos)

    @cached_property
    def actuation(self) -> Actuation:
        """``under``: four wrench rows at most; ``full``: six from six rotors; ``over``: six from more."""
        rank = np.linalg.matrix_rank(self._wrench_matrix(), tol=1e-6)
        return "under" if rank < 6 else ("full" if self.num_rotors == 6 else "over")

    @cached_property
    def vehicle(self) -> Vehicle:
        """The controller's nominal model. The gripper rides on the last link."""
        links = self.arm.links
        mass, com, inertia = self._last_link_with_gripper()
        return Vehicle(
            base_mass=self.base.mass,
            base_inertia=np.array(self.base.inertia),
            link_offset=np.array([link.offset for link in links]),
            link_axis=np.array([link.axis for link in links]),
            link_mass=np.array([*(link.mass for link in links[:-1]), mass]),
            link_com=np.array([*(link.com for link in links[:-1]), com]),
            link_inertia=np.array([*(link.inertia for link in links[:-1]), inertia]),
            tool_offset=np.array(self.tool_offset),
            joint_low=np.array([link.limits[0] for link in links]),
            joint_high=np.array([link.limits[1] for link in links]),
            joint_speed=np.array([link.speed for link in links]),
            joint_stiffness=np.array([link.stiffness for link in links]),
            joint_damping=np.array([link.damping for link in links]),
            rotor_pos=self.base.rotor_pos,
            rotor_axis=self.base.rotor_axis,
            rotor_drag_ratio=self.base.rotor_drag_ratio,
            rotor_max=np.full(self.num_rotors, self.base.max_thrust),
            rotor_radius=self.base.rotor_radius,
            rotor_tau_up=self.base.tau_up,
            rotor_tau_down=self.base.tau_down,
            mixer=mixer_matrix(self._wrench_matrix()),
            lateral_limit=LATERAL_SHARE * self.lateral_force,
            drag=np.array(self.base.drag),
            rest_forward=np.array(self.rest_forward),
            rest_down=np.array(self.rest_down),
        )

    @property
    def tool_offset(self) -> tuple[float, float, float]:
        """Tool point in the last link's frame, m."""
        return (self.arm.links[-1].length + self.gripper.tool_distance, 0.0, 0.0)

    @cached_property
    def lateral_force(self) -> float:
        """Sideways force (N) at level hover in the worst direction, with no torque."""
        wrench = self._wrench_matrix()
        if np.linalg.matrix_rank(wrench, tol=1e-6) < 6:
            return 0.0
        mass = self.base.mass + sum(link.mass for link in self.arm.links) + self.gripper.mass
        mixer = mixer_matrix(wrench)
        hover = mixer[:, 2] * mass * GRAVITY
        directions = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
        extra = mixer[:, :2] @ np.stack([np.cos(directions), np.sin(directions)])
        spare = np.where(extra > 0, self.base.max_thrust - hover[:, None], hover[:, None])
        return float(np.min(spare / np.maximum(np.abs(extra), 1e-9)))

    def add_to(self, spec: mujoco.MjSpec) -> None:
        """Add bodies, joints, actuators, sensors and cameras to a scene, free-floating at the origin.

        The base's free joint comes first, then the arm's joints, then the gripper's; actuators are ordered rotors,
        joints, gripper.
        """
        base = self.base.add_to(spec)
        last = self.arm.add_to(spec, base)
        self.gripper.add_to(spec, last, self.arm.links[-1].length)
        last.add_site(name="tool", pos=self.tool_offset, size=[0.004] * 3, rgba=[1, 0.5, 0, 0.6], group=4)
        self._add_cameras(base, last)

    def _add_cameras(self, base: mujoco.MjsBody, last: mujoco.MjsBody) -> None:
        """``wrist`` looks past the fingers at what they grasp, ``base`` from the base's left at the whole arm."""
        reach = self.tool_offset[0]
        wrist = np.array([0.1 * reach, 0.0, 0.75 * reach])
        ahead = np.array([1.3 * reach, 0.0, 0.1 * reach]) - wrist
        last.add_camera(name="wrist", pos=wrist, quat=look_along(ahead), fovy=75)
        span = self.arm.reach
        pos = np.array([0.25 * span, 0.4 * span, -self.base.hub_size[2]])
        centre = np.array([0.45 * span, 0.0, -0.7 * span])
        base.add_camera(name="base", pos=pos, quat=look_along(centre - pos, up=(1.0, 0.0, 0.0)), fovy=75)

    def _wrench_matrix(self) -> np.ndarray:
        return wrench_matrix(self.base.rotor_pos, self.base.rotor_axis, self.base.rotor_drag_ratio)

    def _last_link_with_gripper(self) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
        """Mass, centre of mass and diagonal inertia of the last link with the gripper welded to it."""
        link = self.arm.links[-1]
        grip = np.array([link.length + self.gripper.com_distance, 0.0, 0.0])
        mass = link.mass + self.gripper.mass
        com = (link.mass * np.array(link.com) + self.gripper.mass * grip) / mass
        inertia = np.array(link.inertia) + np.array(self.gripper.inertia)
        for part, where in ((link.mass, np.array(link.com)), (self.gripper.mass, grip)):
            d = where - com
            inertia = inertia + part * (d @ d - d * d)
        return mass, tuple(com), tuple(inertia)
