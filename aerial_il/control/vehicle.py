"""What a controller knows of an aerial manipulator: nominal masses, geometry, limits. No simulator in sight.

A vehicle is a rigid base with fixed rotors and one serial arm of revolute joints. All frames are aligned with the base
frame (x forward, y left, z up) when every joint is at zero. The gripper's fingers count as part of the last link.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

GRAVITY = 9.81


class Vehicle(NamedTuple):
    """Nominal model of a base with R rotors and an arm of J joints (SI units, radians).

    Attributes:
        base_mass: kg.
        base_inertia: (3,) diagonal about the base origin, kg m².
        link_offset: (J, 3) joint position in the parent link's frame, m.
        link_axis: (J, 3) unit rotation axis in the parent link's frame.
        link_mass: (J,) kg.
        link_com: (J, 3) centre of mass in the link frame, m.
        link_inertia: (J, 3) diagonal about the centre of mass, link axes, kg m².
        tool_offset: (3,) tool point in the last link's frame, m. The tool frame has the link's axes: x points out
            of the gripper.
        joint_low, joint_high: (J,) limits, rad.
        joint_speed: (J,) largest commanded speed, rad/s.
        joint_stiffness, joint_damping: (J,) servo gains, N m/rad and N m s/rad.
        rotor_pos: (R, 3) in the base frame, m.
        rotor_axis: (R, 3) unit thrust direction in the base frame.
        rotor_drag_ratio: (R,) signed torque about the axis per newton of thrust, m.
        rotor_max: (R,) largest thrust, N.
        rotor_radius: m.
        rotor_tau_up, rotor_tau_down: time constants of rising and falling thrust, s.
        mixer: (R, 6) thrusts per unit body wrench (force, torque about the base origin).
        lateral_limit: body-frame sideways force available without tilting, N; 0 for under-actuated vehicles.
        drag: (3,) linear drag of the base along its axes, N s/m.
        rest_forward, rest_down: (J,) postures with the tool horizontal and pointing straight down, rad.
    """

    base_mass: float
    base_inertia: np.ndarray
    link_offset: np.ndarray
    link_axis: np.ndarray
    link_mass: np.ndarray
    link_com: np.ndarray
    link_inertia: np.ndarray
    tool_offset: np.ndarray
    joint_low: np.ndarray
    joint_high: np.ndarray
    joint_speed: np.ndarray
    joint_stiffness: np.ndarray
    joint_damping: np.ndarray
    rotor_pos: np.ndarray
    rotor_axis: np.ndarray
    rotor_drag_ratio: np.ndarray
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
    def mass(self) -> float:
        """Total mass in kg."""
        return float(self.base_mass + self.link_mass.sum())

    @property
    def thrust_to_weight(self) -> float:
        """Largest vertical thrust at level attitude over weight."""
        return float((self.rotor_max * self.rotor_axis[:, 2]).sum() / (self.mass * GRAVITY))


class Gains(NamedTuple):
    """Tuning of the flight controller, mass-normalised so that vehicles of all sizes share it.

    Attributes:
        position, velocity: 1/s² and 1/s, of the base's position loop.
        attitude, rate: 1/s² and 1/s, of the attitude loop.
        max_acceleration: m/s², of the commanded base acceleration.
        max_tilt: rad, of the commanded thrust direction.
        observer: 1/s, bandwidth of the disturbance observer in free flight; 0 switches it off.
        observer_loaded: 1/s, its bandwidth while the gripper is closed.
        observer_limit: largest disturbance force that is compensated, as a share of weight. Without a bound a vehicle
            whose gripper rests on a table would hand its whole weight over to the arm.
        observer_lever: m, times that force gives the largest compensated torque.
        reference_speed, reference_acceleration: m/s, m/s², of the end-effector reference.
        reference_turn: rad/s, its angular speed.
        orientation_weight: m/rad, how much the arm gives up in position for orientation.
    """

    position: float = 20.0
    velocity: float = 9.8
    attitude: float = 250.0
    rate: float = 27.0
    max_acceleration: float = 6.0
    max_tilt: float = 0.6
    observer: float = 6.0
    observer_loaded: float = 3.0
    observer_limit: float = 0.2
    observer_lever: float = 0.2
    reference_speed: float = 0.8
    reference_acceleration: float = 2.0
    reference_turn: float = 1.5
    orientation_weight: float = 0.05
