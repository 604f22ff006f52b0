"""A robot: parameters in SI units, from which both the simulated model and the controller's nominal model are built."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import mujoco
import numpy as np

from aerial_il.control.allocation import mixer_matrix, wrench_matrix
from aerial_il.control.dynamics import forward_kinematics, momentum, tool_pose
from aerial_il.control.scratch import SCRATCH, make_scratch
from aerial_il.control.vehicle import GRAVITY, Vehicle, alone
from aerial_il.control.whole_body import find_posture
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.rotations import IDENTITY, mat_from_quat
from aerial_il.robots.parts.arm import Arm, Vector
from aerial_il.robots.parts.base import Base
from aerial_il.robots.parts.camera import Camera, standard_cameras
from aerial_il.robots.parts.gripper import Gripper

Actuation = Literal["under", "full", "over", "fixed"]
LATERAL_SHARE = 0.9  # of the sideways force at level hover that the controller uses before it tilts
LEAST_THRUST_TO_WEIGHT = 1.5  # to turn and to climb with something in the gripper
REACHED_M, REACHED_RAD = 1e-3, 0.01  # how near a posture must bring the tool to a pose that counts as within reach
LEAST_REACH_SHARE = 0.2  # of the arm's length, between a pose and the axis of a fixed base
STANDARD_SENSORS: Mapping[str, Mapping[str, Any]] = {"base": {}, "arm": {}, "gripper": {}, "tool": {}}
LEAST_REASON_WORDS = 3  # of why a task is declined
UNIT_TOLERANCE = 1e-6
WIDEST_M, FARTHEST_M, MOST_TURN_RAD = 0.5, 3.0, 4 * np.pi  # of a gripper, of a rotor, of a joint
JOINT_ROOM_RAD = 0.08  # that it must keep from its joints' limits


@dataclass(frozen=True)
class Robot:
    """An aerial manipulator.

    Attributes:
        name: registry name.
        summary: one sentence for people.
        base: frame and rotors, or a pedestal.
        arm: serial arm on the base; without links, the base itself is the tool.
        gripper: parallel gripper at the arm's end, or ``NO_GRIPPER``.
        rest_forward, rest_down: (J,) postures with the tool horizontal and pointing straight down, rad.
        cameras: that it carries; None for ``wrist`` and ``base``, placed by its size.
        sensors: name -> settings of what it knows of itself, in the order in which it is observed; each gives as much
            as base, arm and gripper have.
        declines: task -> why the robot cannot do it, a clause that a user reads, e.g. ``its arm cannot turn about two
            axes``: for what no rule of the task finds.

    Raises:
        InvalidValueError: the rotors are too weak for base and arm, a gripper has no arm to sit on, two cameras have
            one name, or a task is declined without a reason.
    """

    name: str
    summary: str
    base: Base
    arm: Arm
    gripper: Gripper
    rest_forward: tuple[float, ...]
    rest_down: tuple[float, ...]
    cameras: tuple[Camera, ...] | None = None
    sensors: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: dict(STANDARD_SENSORS), hash=False)
    declines: Mapping[str, str] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        self._check_declines()
        names = [camera.name for camera in self.cameras or ()]
        if len(set(names)) < len(names):
            raise InvalidValueError(f"{self.name}: each camera needs a name of its own, got {', '.join(names)}.")
        self._check_numbers()
        self._check_units()
        if self.has_gripper and not self.arm.links:
            raise InvalidValueError(f"{self.name}: a gripper needs an arm of at least one joint to sit on.")
        vehicle = self.vehicle
        if not self.fixed and vehicle.thrust_to_weight < LEAST_THRUST_TO_WEIGHT:
            lift, weight = vehicle.thrust_to_weight * vehicle.mass * GRAVITY, vehicle.mass * GRAVITY
            raise InvalidValueError(
                f"{self.name}: {self.num_rotors} rotors lift at most {lift:.1f} N, base and arm weigh {weight:.1f} N: "
                f"{vehicle.thrust_to_weight:.2f} of the weight, and {LEAST_THRUST_TO_WEIGHT} is the least to fly with. "
                f"Each rotor needs {LEAST_THRUST_TO_WEIGHT * weight / self.num_rotors:.1f} N (CA_ROTOR<i>_CT in an "
                "airframe file), or the arm must be lighter."
            )

    def _check_numbers(self) -> None:
        """Refuse what the simulator would read otherwise than the controller's model of the robot does."""
        links, base = self.arm.links, self.base
        axes = {f"axis of joint {i}": link.axis for i, link in enumerate(links)}
        axes |= {f"rotor_axis {i}": axis for i, axis in enumerate(base.rotor_axis)}
        for what, axis in axes.items():
            if abs(np.linalg.norm(axis) - 1.0) > UNIT_TOLERANCE:
                raise InvalidValueError(f"{self.name}: {what} is {[*map(float, axis)]}; it must be of length 1.")
        for what, posture in (("rest_forward", self.rest_forward), ("rest_down", self.rest_down)):
            if len(posture) != len(links):
                raise InvalidValueError(f"{self.name}: {what} has {len(posture)} angles for {len(links)} joints.")
            for i, (angle, link) in enumerate(zip(posture, links, strict=True)):
                if not link.limits[0] <= angle <= link.limits[1]:
                    raise InvalidValueError(
                        f"{self.name}: {what} puts joint {i} at {angle:g} rad; its limits are {link.limits}."
                    )
        if base.tau_down < base.tau_up:
            raise InvalidValueError(
                f"{self.name}: tau_down is {base.tau_down:g} s and tau_up {base.tau_up:g} s; rotors that lose thrust "
                "faster than they gain it are not simulated. Say tau_down=tau_up."
            )

    def _check_units(self) -> None:
        """Refuse numbers of another order than a robot has: they are in another unit."""
        base, stroke = self.base, self.gripper.stroke
        if stroke > WIDEST_M:
            raise InvalidValueError(
                f"{self.name}: the gripper opens by {stroke:g} m, {WIDEST_M} m at most. Is it in mm?"
            )
        for i, link in enumerate(self.arm.links):
            if max(map(abs, link.limits)) > MOST_TURN_RAD:
                raise InvalidValueError(f"{self.name}: joint {i} turns from {link.limits} rad. Are they in degrees?")
        if not self.num_rotors:
            return
        away = float(np.linalg.norm(base.rotor_pos, axis=1).max())
        if away > FARTHEST_M:
            raise InvalidValueError(
                f"{self.name}: a rotor is {away:g} m from the base, {FARTHEST_M} m at most. Is it in mm?"
            )
        most = base.mass * (away + max(base.hub_size)) ** 2  # of a ring that has all of the mass and all of the size
        if max(base.inertia) > most:
            raise InvalidValueError(
                f"{self.name}: the base's inertia is {max(base.inertia):g} kg m²; {base.mass:g} kg as far out as "
                f"its rotors have {most:.2g}. Is it in g m²?"
            )

    def _check_declines(self) -> None:
        for task, reason in self.declines.items():
            if len(reason.split()) < LEAST_REASON_WORDS:
                raise InvalidValueError(
                    f"{self.name} declines {task} because {reason!r}; say why in at least {LEAST_REASON_WORDS} words, "
                    "e.g. 'its arm cannot turn about two axes'."
                )

    @property
    def num_joints(self) -> int:
        return len(self.arm.links)

    @property
    def num_rotors(self) -> int:
        return self.base.num_rotors

    @property
    def has_gripper(self) -> bool:
        """Whether there is anything to grasp with."""
        return self.gripper.stroke > 0.0

    @property
    def fixed(self) -> bool:
        """Whether the base stands still."""
        return self.base.fixed

    @cached_property
    def actuation(self) -> Actuation:
        """``under``: four wrench rows; ``full``: six from six rotors; ``over``: six from more; ``fixed``: none."""
        if self.fixed:
            return "fixed"
        rank = np.linalg.matrix_rank(self._wrench_matrix(), tol=1e-6)
        return "under" if rank < 6 else ("full" if self.num_rotors == 6 else "over")

    @property
    def first_joint(self) -> tuple[int, int]:
        """Index of the arm's first joint in a scene's qpos and qvel: after the base's free joint, if it has one."""
        return (0, 0) if self.fixed else (7, 6)

    @cached_property
    def vehicle(self) -> Vehicle:
        """The controller's nominal model. The gripper rides on the last link."""
        links, masses = self.arm.links, self._link_masses()
        return Vehicle(
            base_mass=self.base.mass,
            base_inertia=np.array(self.base.inertia),
            base_mobility=0.0 if self.fixed else 1.0,
            base_pose=np.array(self.base.pose),
            link_offset=np.reshape(self.arm.offsets, (-1, 3)),
            link_axis=np.reshape([link.axis for link in links], (-1, 3)),
            link_mass=np.array([mass for mass, _, _ in masses]),
            link_com=np.reshape([com for _, com, _ in masses], (-1, 3)),
            link_inertia=np.reshape([inertia for _, _, inertia in masses], (-1, 3)),
            tool_offset=np.array(self.tool_offset),
            gripper_stroke=self.gripper.stroke,
            joint_low=np.array([link.limits[0] for link in links]),
            joint_high=np.array([link.limits[1] for link in links]),
            joint_speed=np.array([link.speed for link in links]),
            joint_stiffness=np.array([link.stiffness for link in links]),
            joint_damping=np.array([link.damping for link in links]),
            rotor_pos=self.base.rotor_pos,
            rotor_axis=self.base.rotor_axis,
            rotor_drag_ratio=self.base.rotor_drag_ratio,
            rotor_min=self.base.rotor_min,
            rotor_max=self.base.rotor_max,
            rotor_radius=self.base.rotor_radius,
            rotor_tau_up=self.base.tau_up,
            rotor_tau_down=self.base.tau_down,
            mixer=np.zeros((0, 6)) if self.fixed else mixer_matrix(self._wrench_matrix()),
            lateral_limit=LATERAL_SHARE * self.lateral_force,
            drag=np.array(self.base.drag),
            rest_forward=np.array(self.rest_forward),
            rest_down=np.array(self.rest_down),
        )

    @cached_property
    def record(self) -> np.record:
        """The nominal model as compiled functions take it."""
        return self.vehicle.record

    @cached_property
    def _record_alone(self) -> np.ndarray:
        """(1,) array of the same."""
        return alone(self.record)

    @property
    def tool_offset(self) -> Vector:
        """Tool point in the last link's frame, or the base's, m."""
        x, y, z = self.arm.tip
        return (x + self.gripper.tool_distance, y, z)

    @cached_property
    def lateral_force(self) -> float:
        """Sideways force (N) at level hover in the worst direction, with no torque."""
        if self.actuation in ("under", "fixed"):
            return 0.0
        mixer = mixer_matrix(self._wrench_matrix())
        hover = mixer[:, 2] * GRAVITY * (self.base.mass + sum(mass for mass, _, _ in self._link_masses()))
        directions = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
        extra = mixer[:, :2] @ np.stack([np.cos(directions), np.sin(directions)])
        above, below = self.base.rotor_max - hover, hover - self.base.rotor_min
        spare = np.where(extra > 0, above[:, None], below[:, None])
        return float(np.min(spare / np.maximum(np.abs(extra), 1e-9)))

    def tool_at(self, joints: tuple[float, ...] | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Tool position (3,) m and rotation (3, 3) in the base frame for joint positions (J,) rad."""
        record, frames = self.record, make_scratch().frames
        forward_kinematics(record, (0.0, 0.0, 0.0), IDENTITY, np.asarray(joints, float), 0, frames)
        pos, rot = tool_pose(record, frames)
        return np.array(pos), np.reshape(rot, (3, 3))

    def centre_at(self, joints: tuple[float, ...]) -> np.ndarray:
        """Centre of mass (3,) m of base, arm and gripper in the base frame for joint positions (J,) rad."""
        record, frames, still = self.record, make_scratch().frames, (0.0, 0.0, 0.0)
        forward_kinematics(record, still, IDENTITY, np.asarray(joints, float), 0, frames)
        _, _, centre, _ = momentum(record, frames, still, IDENTITY, still, still, np.zeros(self.num_joints))
        return np.array(centre)

    @cached_property
    def hang(self) -> float:
        """Distance of the tool below the base's origin when it points straight down, m."""
        return -float(self.tool_at(self.rest_down)[0][2])

    @cached_property
    def longest_reach(self) -> float:
        """Farthest that fingertips ever get from the origin of the base's body, m: no limit if that can fly."""
        stretched = float(np.linalg.norm(self.arm.mount)) + self.arm.reach + self.gripper.finger_length
        return stretched if self.fixed else np.inf

    def posture_for(self, pos: np.ndarray, rot: np.ndarray) -> np.ndarray | None:
        """Joint positions (J,) rad that bring a FIXED robot's tool to a pose, or None if it is out of reach.

        Args:
            pos: (3,) m, rot: (3, 3) of the tool, world frame.
        """
        x, y, z, *quat = self.base.pose
        base_rot, tool_rot = mat_from_quat(tuple(quat)), tuple(np.ravel(rot))
        joints, workspace = np.array(self.rest_down, float), np.zeros(1, SCRATCH)
        distance, angle = find_posture(self._record_alone, workspace, (x, y, z), base_rot, tuple(pos), tool_rot, joints)
        if distance > REACHED_M or angle > REACHED_RAD:
            return None
        room = np.minimum(joints - self.vehicle.joint_low, self.vehicle.joint_high - joints)
        return joints if (room >= JOINT_ROOM_RAD).all() else None

    def reachable(self, pos: np.ndarray, rot: np.ndarray) -> bool:
        """Whether the tool can be brought to a pose in free air; a flying base goes wherever the arm needs it.

        Beside its own first joint a fixed arm would have to turn on the spot; such poses do not count.
        """
        if not self.fixed:
            return True
        beside = float(np.hypot(pos[0] - self.base.pose[0], pos[1] - self.base.pose[1]))
        return beside >= LEAST_REACH_SHARE * self.arm.reach and self.posture_for(pos, rot) is not None

    @cached_property
    def mounted_cameras(self) -> tuple[Camera, ...]:
        """The cameras that it carries."""
        if self.cameras is not None:
            return self.cameras
        return standard_cameras(self.base, self.arm, self.tool_offset, self.tool_at(self.rest_down)[0])

    def add_to(self, spec: mujoco.MjSpec) -> None:
        """Add bodies, joints, actuators, sensors and cameras to a scene, free at the origin or on the pedestal.

        The base's free joint comes first, then the arm's joints, then the gripper's; actuators are ordered rotors,
        joints, gripper.
        """
        base = self.base.add_to(spec)
        last = self.arm.add_to(spec, base)
        if self.has_gripper:
            self.gripper.add_to(spec, last, self.arm.tip)
        last.add_site(name="tool", pos=self.tool_offset, size=[0.004] * 3, rgba=[1, 0.5, 0, 0.6], group=4)
        for camera in self.mounted_cameras:
            camera.add_to(last if camera.on == "tool" else base)

    def _wrench_matrix(self) -> np.ndarray:
        return wrench_matrix(self.base.rotor_pos, self.base.rotor_axis, self.base.rotor_drag_ratio)

    def _link_masses(self) -> list[tuple[float, Vector, Vector]]:
        """Mass, centre of mass and diagonal inertia of every link; the last has the gripper welded to it."""
        links = [(link.mass, link.com, link.inertia) for link in self.arm.links]
        return [*links[:-1], self._with_gripper(*links[-1])] if self.has_gripper else links

    def _with_gripper(self, mass: float, com: Vector, inertia: Vector) -> tuple[float, Vector, Vector]:
        """Join the last link's mass, centre and inertia with the gripper's."""
        gripper = self.gripper
        grip = np.array(self.arm.tip) + np.array([gripper.com_distance, 0.0, 0.0])
        total = mass + gripper.mass
        centre = (mass * np.array(com) + gripper.mass * grip) / total
        joint = np.array(inertia) + np.array(gripper.inertia)
        for part, where in ((mass, np.array(com)), (gripper.mass, grip)):
            d = where - centre
            joint = joint + part * (d @ d - d * d)
        return total, tuple(centre), tuple(joint)
