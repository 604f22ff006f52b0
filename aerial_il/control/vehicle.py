"""Nominal model of an aerial manipulator, as controllers know it: masses, geometry, limits; no simulator.

A vehicle is a rigid base with fixed rotors and one serial arm of revolute joints. All frames are aligned with the base
frame (x forward, y left, z up) when every joint is at zero. The gripper's fingers count as part of the last link.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aerial_il.core.errors import InvalidValueError

GRAVITY = 9.81
MAX_JOINTS, MAX_ROTORS = 8, 12
QUICK_ROTOR_S = 0.035  # rotors with a longer time constant slow everything down in proportion
LONG_ARM_M = 0.4  # an arm this long corrects the base's position with ease


class Vehicle(NamedTuple):
    """Nominal model of a base with R rotors and an arm of J joints (SI units, radians).

    Attributes:
        base_mass: kg.
        base_inertia: (3,) diagonal about the base origin, kg m².
        base_mobility: 1 for a base that moves, 0 for one that is fixed.
        base_pose: (7,) where a fixed base stands: position, m, and quaternion (w, x, y, z).
        link_offset: (J, 3) joint position in the parent link's frame, m.
        link_axis: (J, 3) unit rotation axis in the parent link's frame.
        link_mass: (J,) kg.
        link_com: (J, 3) centre of mass in the link frame, m.
        link_inertia: (J, 3) diagonal about the centre of mass, link axes, kg m².
        tool_offset: (3,) tool point in the last link's frame, or the base's without an arm, m. The tool frame has the
            link's axes: x points out of the gripper.
        gripper_stroke: m per finger; 0 without a gripper.
        joint_low, joint_high: (J,) limits, rad.
        joint_speed: (J,) largest commanded speed, rad/s.
        joint_stiffness, joint_damping: (J,) servo gains, N m/rad and N m s/rad.
        rotor_pos: (R, 3) in the base frame, m.
        rotor_axis: (R, 3) unit thrust direction in the base frame.
        rotor_drag_ratio: (R,) signed torque about the axis per newton of thrust, m.
        rotor_min, rotor_max: (R,) smallest and largest thrust, N; the smallest is below zero where it can be reversed.
        rotor_radius: m; 0 if the rotors feel no ground.
        rotor_tau_up, rotor_tau_down: time constants of rising and falling thrust, s.
        mixer: (R, 6) thrusts per unit body wrench (force, torque about the base origin).
        lateral_limit: body-frame sideways force available without tilting, N; 0 for under-actuated vehicles.
        drag: (3,) linear drag of the base along its axes, N s/m.
        rest_forward, rest_down: (J,) postures with the tool horizontal and pointing straight down, rad.
    """

    base_mass: float
    base_inertia: np.ndarray
    base_mobility: float
    base_pose: np.ndarray
    link_offset: np.ndarray
    link_axis: np.ndarray
    link_mass: np.ndarray
    link_com: np.ndarray
    link_inertia: np.ndarray
    tool_offset: np.ndarray
    gripper_stroke: float
    joint_low: np.ndarray
    joint_high: np.ndarray
    joint_speed: np.ndarray
    joint_stiffness: np.ndarray
    joint_damping: np.ndarray
    rotor_pos: np.ndarray
    rotor_axis: np.ndarray
    rotor_drag_ratio: np.ndarray
    rotor_min: np.ndarray
    rotor_max: np.ndarray
    rotor_radius: float
    rotor_tau_up: float
    rotor_tau_down: float
    mixer: np.ndarray
    lateral_limit: float
    drag: np.ndarray
    rest_forward: np.ndarray
    rest_down: np.ndarray

    @property
    def num_joints(self) -> int:
        return len(self.link_mass)

    @property
    def num_rotors(self) -> int:
        return len(self.rotor_max)

    @property
    def record(self) -> np.record:
        """The same numbers as one block of state of fixed size: what compiled functions take for a vehicle.

        Raises:
            InvalidValueError: more joints or rotors than the block holds.
        """
        if self.num_joints > MAX_JOINTS or self.num_rotors > MAX_ROTORS:
            raise InvalidValueError(
                f"The controller flies up to {MAX_JOINTS} joints and {MAX_ROTORS} rotors; this vehicle has "
                f"{self.num_joints} and {self.num_rotors}."
            )
        block = np.zeros(1, RECORD)
        for name in RECORD.names or ():
            value = np.asarray(getattr(self, name))
            block[name][(0, *(slice(0, n) for n in value.shape))] = value
        return block.view(np.recarray)[0]

    @property
    def mass(self) -> float:
        """Total mass in kg."""
        return float(self.base_mass + self.link_mass.sum())

    @property
    def arm_length(self) -> float:
        """From the first joint to the tool, outstretched, m."""
        return float(np.linalg.norm(self.link_offset[1:], axis=1).sum() + np.linalg.norm(self.tool_offset))

    @property
    def agility(self) -> float:
        """Share of the speed of flight with quick rotors that these allow, in (0, 1]."""
        return QUICK_ROTOR_S / max(QUICK_ROTOR_S, self.rotor_tau_up)

    @property
    def thrust_to_weight(self) -> float:
        """Largest vertical thrust at level attitude over weight."""
        return float((self.rotor_max * self.rotor_axis[:, 2]).sum() / (self.mass * GRAVITY))


def record_of(settings: NamedTuple) -> np.record:
    """The numbers of a named tuple as one block of state.

    Compiled code hands a record on as one address, a named tuple number by number, from each function to the next.
    """
    types = [(name, np.int64 if isinstance(value, int) else np.float64) for name, value in settings._asdict().items()]
    return np.array([tuple(settings)], types).view(np.recarray)[0]


def alone(record: np.record) -> np.ndarray:
    """(1,) array of a record: Python hands it to a compiled function in a twentieth of the time a record takes."""
    return np.array([record], record.dtype)


_PER_JOINT, _PER_ROTOR = (MAX_JOINTS,), (MAX_ROTORS,)
RECORD = np.dtype(
    [
        ("num_joints", np.int64),
        ("num_rotors", np.int64),
        *((name, np.float64) for name in ("base_mass", "rotor_radius", "rotor_tau_up", "rotor_tau_down")),
        *((name, np.float64) for name in ("lateral_limit", "gripper_stroke", "base_mobility")),
        ("base_pose", np.float64, (7,)),
        *((name, np.float64, (3,)) for name in ("base_inertia", "tool_offset", "drag")),
        *((name, np.float64, (MAX_JOINTS, 3)) for name in ("link_offset", "link_axis", "link_com", "link_inertia")),
        *((name, np.float64, _PER_JOINT) for name in ("link_mass", "joint_low", "joint_high", "joint_speed")),
        *((name, np.float64, _PER_JOINT) for name in ("joint_stiffness", "joint_damping", "rest_forward", "rest_down")),
        *((name, np.float64, (MAX_ROTORS, 3)) for name in ("rotor_pos", "rotor_axis")),
        *((name, np.float64, _PER_ROTOR) for name in ("rotor_drag_ratio", "rotor_min", "rotor_max")),
        ("mixer", np.float64, (MAX_ROTORS, 6)),
    ],
    align=True,
)


class Gains(NamedTuple):
    """Tuning of the flight controller, mass-normalised so that vehicles of all sizes share it, see :meth:`fitted`.

    Attributes:
        position, velocity: 1/s² and 1/s, of the base's position loop.
        attitude, rate: 1/s² and 1/s, of the attitude loop.
        max_acceleration: m/s², of the commanded base acceleration.
        max_tilt: rad, of the commanded thrust direction.
        rotor_response: s, time constant that slower rotors are made to have; faster ones keep their own.
        observer: 1/s, bandwidth of the disturbance observer in free flight; 0 switches it off.
        observer_loaded: 1/s, its bandwidth while the gripper is closed.
        observer_limit: largest disturbance force that is compensated, as a share of weight. Without a bound a vehicle
            whose gripper rests on a table would hand its whole weight over to the arm.
        observer_lever: m, times that force gives the largest compensated torque.
        reference_speed, reference_acceleration: m/s, m/s², of the end-effector reference.
        reference_turn: rad/s, its angular speed.
        orientation_weight: m/rad, how much the arm gives up in position for orientation.
        integral, attitude_integral: 1/s³, of the PID law's position loop, and of its roll and pitch loops.
        heading, heading_integral, heading_rate: 1/s², 1/s³ and 1/s, of its yaw loop; torque about yaw is the weakest
            that rotors have.
    """

    position: float = 20.0
    velocity: float = 9.8
    attitude: float = 250.0
    rate: float = 27.0
    max_acceleration: float = 6.0
    max_tilt: float = 0.6
    rotor_response: float = 0.025
    observer: float = 6.0
    observer_loaded: float = 3.0
    observer_limit: float = 0.2
    observer_lever: float = 0.2
    reference_speed: float = 0.8
    reference_acceleration: float = 2.0
    reference_turn: float = 1.5
    orientation_weight: float = 0.05
    integral: float = 10.0
    attitude_integral: float = 300.0
    heading: float = 16.0
    heading_integral: float = 5.0
    heading_rate: float = 8.0

    def fitted(self, vehicle: Vehicle) -> Gains:
        """The same flight for a vehicle with slow rotors or a short arm.

        Slow rotors stretch time by ``1 / agility``. A short arm would have to turn far for every millimetre that the
        base is off, or is measured to be: the shorter it is, the more it keeps the tool's orientation instead.
        """
        agility = vehicle.agility
        slow, slower, slowest = agility, agility * agility, agility * agility * agility
        shortness = max(1.0, LONG_ARM_M / vehicle.arm_length) if vehicle.num_joints else 1.0
        return self._replace(
            orientation_weight=shortness * self.orientation_weight,
            position=slower * self.position,
            velocity=slow * self.velocity,
            attitude=slower * self.attitude,
            rate=slow * self.rate,
            reference_speed=slow * self.reference_speed,
            reference_acceleration=slower * self.reference_acceleration,
            reference_turn=slow * self.reference_turn,
            integral=slowest * self.integral,
            attitude_integral=slowest * self.attitude_integral,
            heading=slower * self.heading,
            heading_integral=slowest * self.heading_integral,
            heading_rate=slow * self.heading_rate,
        )


GAINS = record_of(Gains()).dtype
