"""Effects of real rotors that the simulated ones lack, computed from a robot's parameters; see ``docs/physics.md``.

A rotor of radius R that lifts T turns at ``Ω = 2π sqrt(T / (c_T ρ (2R)⁴))``; its polar inertia is that of slender rods,
``J = m R² / 3``. Static thrust coefficients of small propellers lie around 0.1 (Brandt and Selig, "Propeller
Performance Data at Low Reynolds Numbers", AIAA 2011-1255). Mass and solidity of the propellers are our assumptions:
all torques here are in proportion to that mass.
"""

from __future__ import annotations

import math

import numpy as np

from aerial_il.control.vehicle import GRAVITY
from aerial_il.robots.figures import AIR_DENSITY
from aerial_il.robots.robot import Robot

THRUST_COEFFICIENT = 0.10  # T / (ρ n² D⁴)
PROPELLER_KG_M2 = 0.75  # mass over radius squared: 27 g at a radius of 0.19 m
SOLIDITY, LIFT_SLOPE = 0.08, 5.7  # blade area over disc area; of a blade's section, per rad


def has_rotors(robot: Robot) -> bool:
    """Whether anything turns in the air."""
    return not robot.fixed and robot.base.rotor_radius > 0.0


def rotor_speed(robot: Robot, thrust: np.ndarray) -> np.ndarray:
    """Angular speed, rad/s, of rotors that lift ``thrust`` N; any shape."""
    diameter = 2.0 * robot.base.rotor_radius
    return 2.0 * math.pi * np.sqrt(np.maximum(thrust, 0.0) / (THRUST_COEFFICIENT * AIR_DENSITY * diameter**4))


def rotor_inertia(robot: Robot) -> float:
    """Polar moment of inertia of one propeller, kg m²."""
    return PROPELLER_KG_M2 * robot.base.rotor_radius**4 / 3.0


def angular_momentum(robot: Robot, thrust: np.ndarray) -> np.ndarray:
    """(..., 3) of all rotors in the base frame, N m s, for thrusts (..., R) N: they turn against their drag torque."""
    spin = -np.sign(robot.base.rotor_drag_ratio)[:, None] * robot.base.rotor_axis
    return rotor_inertia(robot) * rotor_speed(robot, thrust) @ spin


def gyroscopic_torque(robot: Robot, rates: np.ndarray, thrust: np.ndarray) -> np.ndarray:
    """(..., 3) torque on the base, N m, that turning it at ``rates`` (..., 3) rad/s meets: ``-ω × h``."""
    return -np.cross(rates, angular_momentum(robot, thrust))


def spin_up_torque(robot: Robot, thrust: np.ndarray, dt: float) -> np.ndarray:
    """(T - 1, 3) reaction on the base, N m, to rotors that change speed, for thrusts (T, R) N every ``dt`` s."""
    return -np.diff(angular_momentum(robot, thrust), axis=0) / dt


def hover_thrust(robot: Robot) -> np.ndarray:
    """(R,) N at level hover without torque."""
    return robot.vehicle.mixer[:, 2] * robot.vehicle.mass * GRAVITY


def authority(robot: Robot) -> np.ndarray:
    """(3,) torque about each axis of the base, N m, that the rotors can add either way to hovering."""
    hover, push = hover_thrust(robot), np.abs(robot.vehicle.mixer[:, 3:])
    spare = np.minimum(robot.base.rotor_max - hover, hover - robot.base.rotor_min)
    return np.min(spare[:, None] / np.maximum(push, 1e-9), axis=0)


def thrust_lost_in_climb(robot: Robot) -> float:
    """Share of hover thrust lost per m/s of climb at constant rotor speed.

    Blade elements ``c = σa/2 (θ/3 - λ/2)`` and momentum ``c = 2λ(λ - λ_c)`` together give, about hover with induced
    velocity v, ``dT/T = -(σa/4) / (4λ + σa/4) dV/v`` (after Leishman, Principles of Helicopter Aerodynamics, ch. 3).
    """
    area = math.pi * robot.base.rotor_radius**2
    thrust = float(np.mean(hover_thrust(robot)))
    induced = math.sqrt(thrust / (2.0 * AIR_DENSITY * area))
    inflow = induced / (float(rotor_speed(robot, np.array(thrust))) * robot.base.rotor_radius)
    blade = SOLIDITY * LIFT_SLOPE / 4.0
    return blade / (4.0 * inflow + blade) / induced
