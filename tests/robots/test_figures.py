"""The figures of a robot's page agree with MuJoCo and with theory."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from aerial_il import robots
from aerial_il.control.vehicle import GRAVITY
from aerial_il.robots import figures
from aerial_il.robots.robot import Robot
from tests.robots.test_robots import compiled

ROBOTS = [robots.get(name) for name in robots.names()]
each_robot = pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
each_flying = pytest.mark.parametrize("robot", [r for r in ROBOTS if not r.fixed], ids=lambda robot: robot.name)


def posed(robot: Robot, joints: tuple[float, ...]) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The simulated robot with its base at the origin, arm in a posture, fingers closed."""
    model = compiled(robot)
    data = mujoco.MjData(model)
    first, _ = robot.first_joint
    data.qpos[first : first + robot.num_joints] = joints
    mujoco.mj_forward(model, data)
    return model, data


@each_robot
def test_the_centre_of_mass_is_that_of_the_simulated_robot(robot: Robot) -> None:
    _, data = posed(robot, robot.rest_down)
    com = data.subtree_com[1] - data.xpos[1]
    np.testing.assert_allclose(figures.stances(robot)[0].com, com, atol=2e-3)


@each_flying
def test_the_inertia_is_that_of_the_simulated_robot(robot: Robot) -> None:
    model, data = posed(robot, robot.rest_down)
    about_com = np.zeros((3, 3))
    for body in range(1, model.nbody):
        axes, lever = data.ximat[body].reshape(3, 3), data.xipos[body] - data.subtree_com[1]
        about_com += axes @ np.diag(model.body_inertia[body]) @ axes.T
        about_com += model.body_mass[body] * (lever @ lever * np.eye(3) - np.outer(lever, lever))
    np.testing.assert_allclose(figures.stances(robot)[0].inertia, np.diag(about_com), rtol=0.03)


@each_flying
def test_hover_thrusts_balance_weight_and_the_arm(robot: Robot) -> None:
    vehicle = robot.vehicle
    for stance in figures.stances(robot):
        push = stance.thrust[:, None] * vehicle.rotor_axis
        np.testing.assert_allclose(push.sum(axis=0)[2], vehicle.mass * GRAVITY, rtol=1e-6)
        about_com = np.cross(vehicle.rotor_pos - stance.com, push).sum(axis=0)
        about_com += (vehicle.rotor_drag_ratio[:, None] * push).sum(axis=0)
        np.testing.assert_allclose(about_com, 0.0, atol=1e-6 * vehicle.mass)
        assert (stance.thrust < 0.9 * vehicle.rotor_max).all(), f"{stance.name} leaves no thrust to fly with"


def test_the_front_rotors_carry_an_arm_that_is_ahead() -> None:
    down, _, stretched = figures.stances(robots.get("big_four_z1"))
    assert stretched.tool[0] > 0.6
    assert 0.05 < stretched.com[0] < 0.12
    front, rear = stretched.thrust[[0, 2]].mean(), stretched.thrust[[1, 3]].mean()
    assert front > rear + 5.0
    assert np.ptp(down.thrust) < np.ptp(stretched.thrust)


def test_hover_power_is_that_of_momentum_theory() -> None:
    """Twice the disc loading costs the square root of two; 2.3 kg on four rotors of 12 cm take about 160 W ideally."""
    robot = robots.get("ua_quad_arm4")
    thrust, area = 0.25 * robot.vehicle.mass * GRAVITY, np.pi * 0.12**2
    even = 4.0 * thrust * np.sqrt(thrust / (2.0 * 1.225 * area))
    power = figures.hover_power(robot)
    assert power is not None
    assert even <= power < 1.1 * even
    assert figures.hover_power(robots.get("floating_gripper")) is None
    assert figures.hover_power(robots.get("z1")) is None


def test_an_arm_that_stands_on_top_has_figures() -> None:
    robot = robots.get("ua_quad_arm4")
    on_top = replace(robot, name="top", arm=replace(robot.arm, mount=(0.0, 0.0, 0.5)))
    joints, tools = figures.workspace(on_top)
    assert len(joints) == len(tools) > 0
    assert len(figures.stances(on_top)) == 3


@pytest.mark.parametrize("robot", [r for r in ROBOTS if r.num_joints], ids=lambda robot: robot.name)
def test_the_workspace_holds_both_rest_postures(robot: Robot) -> None:
    _, tools = figures.workspace(robot)
    assert len(tools) > 1000
    for posture in (robot.rest_down, robot.rest_forward):
        nearest = np.linalg.norm(tools - robot.tool_at(posture)[0], axis=1).min()
        assert nearest < 0.1
    assert (np.linalg.norm(tools, axis=1) < robot.arm.reach + robot.gripper.finger_length + 0.2).all()
    for posture in (robot.rest_down, robot.rest_forward):
        np.testing.assert_allclose(figures.chain(robot, np.array(posture))[-1], robot.tool_at(posture)[0])
