"""The figures in ``docs/physics.md`` of what the rotors leave out are those of the robots and of their flights.

A rotor of radius R that lifts T turns at ``Ω = 2π sqrt(T / (c_T ρ (2R)⁴))``; its polar inertia is that of slender rods,
``J = m R² / 3``. Static thrust coefficients of small propellers lie around 0.1 (Brandt and Selig, "Propeller
Performance Data at Low Reynolds Numbers", AIAA 2011-1255). Mass and solidity of the propellers are our assumptions:
all torques here are in proportion to that mass.
"""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il import robots
from aerial_il.control.vehicle import GRAVITY
from aerial_il.robots.figures import AIR_DENSITY, stances
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


PAGE = Path(__file__).parents[2] / "docs" / "physics.md"
NAMES = [name for name in robots.names() if has_rotors(robots.get(name))]
each_robot = pytest.mark.parametrize("name", NAMES)
WORLDS, STEPS, DT = 8, 400, 0.02


@cache
def flights(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Body rates (T, n, 3) rad/s and thrusts (T, n, R) N of expert flights in gusts."""
    task = "pick_place" if (name, "pick_place") in aerial_il.list_cells() else "track"
    env, expert = aerial_il.load_batch(name, task, num_envs=WORLDS, tier="gusts"), aerial_il.expert(name, task)
    expert.attach(env)
    obs = env.reset(920_000)
    expert.reset()
    rates, thrusts = [], []
    for _ in range(STEPS):
        obs = env.step(expert.act(obs)).obs
        rates.append(env.simulation.view.base_angvel.copy())
        thrusts.append(env.simulation.view.thrust.copy())
    env.close()
    return np.array(rates), np.array(thrusts)


def figures(name: str) -> list[float]:
    """One row of the table: what its head says."""
    robot, (rates, thrusts) = robots.get(name), flights(name)
    hover, spare = hover_thrust(robot), authority(robot)
    gyro = np.abs(gyroscopic_torque(robot, rates, thrusts))
    spin = np.abs(spin_up_torque(robot, thrusts, DT))
    momentum = angular_momentum(robot, thrusts)
    moved = [stance.com for stance in stances(robot)][:2]
    arm = robot.vehicle.mass * GRAVITY * np.linalg.norm(moved[-1] - moved[0])
    return [
        1e6 * rotor_inertia(robot),
        float(np.mean(rotor_speed(robot, hover))),
        float(min(spare[:2])),
        float(spare[2]),
        float(arm),
        float(np.quantile(np.linalg.norm(rates, axis=-1), 0.99)),
        float(np.quantile(gyro[..., :2].max(axis=-1), 0.99)),
        float(np.quantile(spin[..., 2], 0.99)),
        float(np.quantile(np.abs(momentum[..., 2]), 0.99) / stances(robot)[0].inertia[2]),
        100.0 * thrust_lost_in_climb(robot),
    ]


def row(name: str) -> str:
    return f"| {name} | " + " | ".join(f"{value:.3g}" for value in figures(name)) + " |"


@pytest.mark.parametrize("name", [name for name in NAMES if (PAGE.parent / "robots" / f"{name}.md").exists()])
def test_the_page_has_the_figures(name: str) -> None:
    """Of those that have a page, too: a robot of one's own needs none."""
    line_of = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith(f"| {name} |")]
    assert line_of, f"docs/physics.md lacks the row {row(name)}"
    numbers = [float(cell) for cell in line_of[0].strip("| ").split("|")[1:]]
    np.testing.assert_allclose(numbers, figures(name), rtol=0.15, atol=2e-3, err_msg=row(name))


@each_robot
def test_the_gyroscopic_torque_is_small_beside_control(name: str) -> None:
    """What would have to be modelled if it were not so."""
    tilting, gyro = figures(name)[2], figures(name)[6]
    assert 0.0 < gyro < 0.05 * tilting
