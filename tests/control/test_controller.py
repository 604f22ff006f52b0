"""The public controller flies robots in a plain MuJoCo model: no suite, no task."""

import numpy as np
import pytest

from aerial_il import robots
from aerial_il.control.actions import ActionLevel, hover_action
from aerial_il.control.controller import Controller
from aerial_il.control.vehicle import GRAVITY, Gains
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.rotations import rot6d_from_mat
from tests.control.in_the_air import ARMED, FLYING, Flight

each_robot = pytest.mark.parametrize("robot", FLYING)
each_armed = pytest.mark.parametrize("robot", ARMED)


@each_robot
def test_the_tool_settles_where_it_is_sent(robot: str) -> None:
    flight = Flight(robot)
    action = flight.pose((0.4, -0.3, 0.2))
    flight.fly(action, 4.0)
    assert np.linalg.norm(flight.tool - action[:3]) < 0.01
    assert np.linalg.norm(flight.data.qvel[:3]) < 0.02
    np.testing.assert_allclose(rot6d_from_mat(flight.data.site("tool").xmat), action[3:9], atol=0.05)


@each_robot
def test_the_tool_does_not_shoot_past_its_target(robot: str) -> None:
    flight = Flight(robot)
    start, action = flight.tool.copy(), flight.pose((0.5, 0.0, 0.0))
    furthest = start[0]
    for _ in range(30):
        flight.fly(action, 0.1)
        furthest = max(furthest, flight.tool[0])
    assert furthest < action[0] + 0.03


@each_armed
def test_it_reaches_a_pose_that_needs_the_arm_and_the_base(robot: str) -> None:
    """From pointing down to pointing 45° forward and 30° to the left."""
    flight = Flight(robot)
    yaw, pitch = np.deg2rad(30.0), np.deg2rad(45.0)
    x = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)])
    y = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    action = np.array([*(flight.tool + np.array([0.2, 0.1, 0.1])), *x, *y, 1.0])
    flight.fly(action, 6.0)
    rot = flight.data.site("tool").xmat.reshape(3, 3)
    assert np.linalg.norm(flight.tool - action[:3]) < 0.015
    assert np.rad2deg(np.arccos(np.clip(rot[:, 0] @ x, -1, 1))) < 3.0
    joints = flight.data.qpos[7 : 7 + flight.joints]
    assert (joints > flight.vehicle.joint_low - 0.02).all()
    assert (joints < flight.vehicle.joint_high + 0.02).all()


@each_robot
def test_the_observer_finds_a_constant_force_and_the_tool_stays(robot: str) -> None:
    flight = Flight(robot)
    action, force = flight.pose(), 0.08 * flight.vehicle.mass * GRAVITY * np.array([0.6, -0.5, 0.3])
    flight.fly(action, 3.0, tuple(force))
    np.testing.assert_allclose(flight.controller.disturbance[:3], force, atol=0.05 * np.linalg.norm(force))
    assert np.linalg.norm(flight.tool - action[:3]) < 0.015


@each_robot
def test_without_the_observer_the_same_force_pushes_it_away(robot: str) -> None:
    flight = Flight(robot, gains=Gains(observer=0.0, observer_loaded=0.0))
    start, action = flight.data.qpos[:3].copy(), flight.pose()
    flight.fly(action, 3.0, (0.08 * flight.vehicle.mass * GRAVITY, 0.0, 0.0))
    assert np.linalg.norm(flight.data.qpos[:3] - start) > 0.02


@each_robot
def test_a_velocity_command_is_flown(robot: str) -> None:
    flight = Flight(robot, "velocity")
    start = flight.data.qpos[:3].copy()
    action = np.zeros(flight.controller.spec.size)
    action[[0, 2, 3]] = 0.4, 0.1, 0.5
    flight.fly(action, 3.0)
    np.testing.assert_allclose(flight.data.qvel[:3], [0.4, 0.0, 0.1], atol=0.03)
    assert flight.data.qpos[0] - start[0] == pytest.approx(1.2, abs=0.2)
    assert flight.data.qvel[5] == pytest.approx(0.5, abs=0.05)


@each_robot
def test_a_base_and_joint_command_is_flown(robot: str) -> None:
    flight = Flight(robot, "base_joint")
    joints = flight.vehicle.rest_forward
    action = np.array([0.3, 0.2, 2.2, 0.6, *joints, 1.0])[: flight.controller.spec.size]
    flight.fly(action, 4.0)
    np.testing.assert_allclose(flight.data.qpos[:3], action[:3], atol=0.02)
    np.testing.assert_allclose(flight.data.qpos[7 : 7 + flight.joints], joints, atol=0.03)
    yaw = 2.0 * np.arctan2(flight.data.qpos[6], flight.data.qpos[3])
    assert yaw == pytest.approx(0.6, abs=0.03)


@each_robot
def test_body_rates_are_flown(robot: str) -> None:
    flight = Flight(robot, "ctbr")
    weight = flight.vehicle.mass * GRAVITY
    action = np.array([weight, 0.3, -0.2, 0.4, *flight.vehicle.rest_down, 1.0])
    flight.fly(action[: flight.controller.spec.size], 0.8)
    np.testing.assert_allclose(flight.data.qvel[3:6], [0.3, -0.2, 0.4], atol=0.08)


@each_robot
def test_rotor_commands_pass_through_within_limits(robot: str) -> None:
    flight = Flight(robot, "rotor")
    action = hover_action(ActionLevel.ROTOR, flight.vehicle, np.zeros(3), np.zeros(6))
    action[: flight.rotors] = np.linspace(-5.0, 200.0, flight.rotors)
    joints = flight.joints
    thrust, _ = flight.controller.update(
        action, flight.data.qpos[: 7 + joints], flight.data.qvel[: 6 + joints], flight.data.act[: flight.rotors].copy()
    )
    np.testing.assert_array_equal(
        thrust, np.clip(action[: flight.rotors], flight.vehicle.rotor_min, flight.vehicle.rotor_max)
    )


def test_bad_numbers_are_refused() -> None:
    flight = Flight(robots.names()[0])
    sizes = {"qpos": 7 + flight.joints, "qvel": 6 + flight.joints, "thrust_now": flight.rotors}
    arguments = [np.ones(size) for size in sizes.values()]
    for action in (np.zeros(3), np.full(10, np.nan)):
        with pytest.raises(InvalidValueError, match="ee_pose action is 10 finite numbers"):
            flight.controller.update(action, *arguments)
    for i, (name, size) in enumerate(sizes.items()):
        for wrong in (np.ones(size - 1), np.ones(size + 1), np.full(size, np.nan)):
            given = [*arguments[:i], wrong, *arguments[i + 1 :]]
            with pytest.raises(InvalidValueError, match=f"{name} is {size} finite numbers"):
                flight.controller.update(np.zeros(10), *given)
    with pytest.raises(UnknownNameError, match="Did you mean 'ee_pose'"):
        Controller(flight.vehicle, level="ee_pos")


def test_reset_forgets_the_past() -> None:
    flight, other = Flight(robots.names()[0]), Flight(robots.names()[0])
    flight.fly(flight.pose((0.3, 0.0, 0.0)), 0.5)
    flight.controller.reset()
    np.testing.assert_array_equal(flight.controller.state, other.controller.state)


@each_armed
def test_displacements_add_up_in_the_tools_own_frame(robot: str) -> None:
    flight = Flight(robot, "ee_delta")
    start, rot = flight.tool.copy(), flight.data.site("tool").xmat.reshape(3, 3).copy()
    still = np.array([*np.zeros(6), 1.0])
    flight.fly(np.array([0.004, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), 1.0)  # out of the gripper, 0.2 m/s
    flight.fly(still, 2.0)
    np.testing.assert_allclose(flight.tool - start, 0.2 * rot[:, 0], atol=0.01)
    flight.fly(np.array([0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 1.0]), 0.5)  # about the gripper's axis, 0.5 rad/s
    flight.fly(still, 3.0)
    turned = rot.T @ flight.data.site("tool").xmat.reshape(3, 3)
    assert np.arctan2(turned[2, 1], turned[1, 1]) == pytest.approx(0.25, abs=0.03)
