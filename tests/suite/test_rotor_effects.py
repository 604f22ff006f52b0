"""The figures in ``docs/physics.md`` of what the rotors leave out are those of the robots and of their flights."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il import robots
from aerial_il.control.vehicle import GRAVITY
from aerial_il.robots.figures import stances
from aerial_il.suite.physics import rotor_effects as effects

PAGE = Path(__file__).parents[2] / "docs" / "physics.md"
NAMES = [name for name in robots.names() if effects.has_rotors(robots.get(name))]
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
    act, rates, thrusts = env.simulation.worlds.bind("act"), [], []
    for _ in range(STEPS):
        obs = env.step(expert.act(obs)).obs
        rates.append(env.simulation.view.base_angvel.copy())
        thrusts.append(act[:, : robots.get(name).num_rotors].copy())
    env.close()
    return np.array(rates), np.array(thrusts)


def figures(name: str) -> list[float]:
    """One row of the table: what its head says."""
    robot, (rates, thrusts) = robots.get(name), flights(name)
    hover, authority = effects.hover_thrust(robot), effects.authority(robot)
    gyro = np.abs(effects.gyroscopic_torque(robot, rates, thrusts))
    spin = np.abs(effects.spin_up_torque(robot, thrusts, DT))
    momentum = effects.angular_momentum(robot, thrusts)
    moved = [stance.com for stance in stances(robot)][:2]
    arm = robot.vehicle.mass * GRAVITY * np.linalg.norm(moved[-1] - moved[0])
    return [
        1e6 * effects.rotor_inertia(robot),
        float(np.mean(effects.rotor_speed(robot, hover))),
        float(min(authority[:2])),
        float(authority[2]),
        float(arm),
        float(np.quantile(np.linalg.norm(rates, axis=-1), 0.99)),
        float(np.quantile(gyro[..., :2].max(axis=-1), 0.99)),
        float(np.quantile(spin[..., 2], 0.99)),
        float(np.quantile(np.abs(momentum[..., 2]), 0.99) / stances(robot)[0].inertia[2]),
        100.0 * effects.thrust_lost_in_climb(robot),
    ]


def row(name: str) -> str:
    return f"| {name} | " + " | ".join(f"{value:.3g}" for value in figures(name)) + " |"


@each_robot
def test_the_page_tells_the_figures(name: str) -> None:
    told = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith(f"| {name} |")]
    assert told, f"docs/physics.md lacks the row {row(name)}"
    numbers = [float(cell) for cell in told[0].strip("| ").split("|")[1:]]
    np.testing.assert_allclose(numbers, figures(name), rtol=0.15, atol=2e-3, err_msg=row(name))


@each_robot
def test_rotors_that_turn_alike_in_pairs_have_no_momentum_in_hover(name: str) -> None:
    robot = robots.get(name)
    hover = effects.hover_thrust(robot)
    each = effects.rotor_inertia(robot) * effects.rotor_speed(robot, hover).sum()
    assert np.linalg.norm(effects.angular_momentum(robot, hover)) < 1e-3 * each
    one = np.where(robot.base.rotor_drag_ratio > 0.0, hover, 0.0)
    assert effects.angular_momentum(robot, one)[2] == pytest.approx(-0.5 * each, rel=0.1), "against their drag torque"


@each_robot
def test_the_gyroscopic_torque_is_small_beside_control(name: str) -> None:
    """What would have to be modelled if it were not so."""
    tilting, gyro = figures(name)[2], figures(name)[6]
    assert 0.0 < gyro < 0.05 * tilting
