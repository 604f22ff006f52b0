"""Whole-body inverse kinematics converges, stays within limits and respects frozen coordinates."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerial_il.control import controller_state as layout
from aerial_il.control.dynamics import forward_kinematics, tool_pose
from aerial_il.control.flight import observe_disturbance
from aerial_il.control.inverse_kinematics import (
    freeze_at_limits,
    rest_posture,
    solve_in_joint_space,
    solve_in_task_space,
)
from aerial_il.control.scratch import FRAME_SIZE, make_scratch
from aerial_il.control.vehicle import Vehicle
from aerial_il.control.whole_body import advance_base, plan_reference, seat_references
from aerial_il.core.rotations import IDENTITY, mat_from_yaw
from tests.control.nominal import VEHICLES, each_vehicle

DT, INTERVAL = 0.004, 0.02


def solve(vehicle: Vehicle, target: np.ndarray, rot: np.ndarray, plans: int = 150) -> np.ndarray:
    """Controller state after following a fixed tool pose from hover for some plans."""
    state, record, scratch = np.zeros(layout.CONTROLLER_STATE_SIZE), vehicle.record, make_scratch()
    seat_references(record, scratch, state, (0.0, 0.0, 1.5), IDENTITY, 0.0, vehicle.rest_down.copy())
    state[layout.TOOL_POS : layout.TOOL_POS + 3] = target
    state[layout.TOOL_ROT : layout.TOOL_ROT + 9] = rot.ravel()
    for _ in range(plans):
        plan_reference(record, scratch, state, INTERVAL)
        advance_base(state, INTERVAL)
        joints = state[layout.JOINT_REF : layout.JOINT_REF + len(vehicle.link_mass)]
        assert (joints >= vehicle.joint_low).all()
        assert (joints <= vehicle.joint_high).all()
    return state


def tool_of(vehicle: Vehicle, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    count = len(vehicle.link_mass)
    frames = np.empty((count + 1, FRAME_SIZE))
    pos = tuple(state[layout.BASE_POS : layout.BASE_POS + 3])
    joints = state[layout.JOINT_REF : layout.JOINT_REF + count]
    forward_kinematics(vehicle.record, pos, mat_from_yaw(state[layout.BASE_YAW]), joints, 0, frames)
    tool, rot = tool_pose(vehicle.record, frames)
    return np.array(tool), np.reshape(rot, (3, 3))


def pitched(yaw: float, pitch: float) -> np.ndarray:
    """Rotation of a tool with heading ``yaw`` that points ``pitch`` rad below the horizon."""
    c, s, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    return np.array([[c * cp, -s, c * sp], [s * cp, c, s * sp], [-sp, 0.0, cp]])


@settings(deadline=None, max_examples=25)
@given(
    st.sampled_from(list(VEHICLES.values())), st.floats(-1, 1), st.floats(-1, 1), st.floats(0.3, 2), st.floats(-1, 1),
    st.floats(0.3, 1.5),
)  # fmt: skip
def test_it_converges_to_any_pose(vehicle: Vehicle, x: float, y: float, z: float, yaw: float, pitch: float) -> None:
    target, rot = np.array([x, y, z]), pitched(yaw, pitch)
    tool, reached = tool_of(vehicle, solve(vehicle, target, rot))
    np.testing.assert_allclose(tool, target, atol=1e-3)
    assert np.trace(reached.T @ rot) > 1.0 + 2.0 * np.cos(np.deg2rad(2.0))


@each_vehicle
def test_a_tool_pointing_backwards_keeps_joint_limits(vehicle: Vehicle) -> None:
    solve(vehicle, np.array([0.0, 0.0, 1.0]), pitched(0.0, -2.5))


@each_vehicle
def test_the_rest_posture_has_the_pitch_it_is_for(vehicle: Vehicle) -> None:
    for pitch in (0.2, 0.8, 0.5 * np.pi):
        posture, frames = np.empty(len(vehicle.link_mass)), np.empty((len(vehicle.link_mass) + 1, FRAME_SIZE))
        rest_posture(vehicle.record, pitch, posture, 0)
        forward_kinematics(vehicle.record, (0.0, 0.0, 0.0), IDENTITY, posture, 0, frames)
        _, rot = tool_pose(vehicle.record, frames)
        np.testing.assert_allclose(np.reshape(rot, (3, 3)), pitched(0.0, pitch), atol=1e-9)


def random_problem(count: int, seed: int) -> np.record:
    """Working memory with a random Jacobian and error for the first ``count`` coordinates."""
    rng, scratch = np.random.default_rng(seed), make_scratch()
    scratch.jacobian[:, :count], scratch.error[:] = rng.standard_normal((6, count)), rng.standard_normal(6)
    scratch.weight[:], scratch.mobility[:] = 1.0, 1.0
    return scratch


def test_one_step_solves_a_linear_task_and_moves_nothing_frozen() -> None:
    scratch = random_problem(9, seed=0)
    jacobian, error = scratch.jacobian[:, :9], scratch.error
    solve_in_task_space(scratch, 9, 1e-9)
    np.testing.assert_allclose(jacobian @ scratch.step[:9], error, atol=1e-9)
    np.testing.assert_allclose(scratch.step[:9], np.linalg.pinv(jacobian) @ error, atol=1e-9)
    scratch.mobility[2], scratch.pull[:] = 0.0, 1.0
    solve_in_task_space(scratch, 9, 1e-9)
    assert scratch.step[2] == 0.0
    np.testing.assert_allclose(jacobian @ scratch.step[:9], error, atol=1e-9)


@pytest.mark.parametrize("frozen", [(), (5,), (4, 6)])
def test_joint_space_and_task_space_find_the_same_minimum(frozen: tuple[int, ...]) -> None:
    scratch, rng = random_problem(8, seed=1), np.random.default_rng(2)
    scratch.weight[:], scratch.mobility[:8] = rng.uniform(0.1, 1.0, 6), rng.uniform(0.5, 2.0, 8)
    scratch.pull[:8] = rng.standard_normal(8)
    scratch.mobility[:4] = 0.0  # the base stays where it is
    scratch.mobility[list(frozen)] = 0.0
    solve_in_task_space(scratch, 8, 0.05)
    wanted = scratch.step[:8].copy()
    scratch.step[:] = 0.0
    solve_in_joint_space(scratch, 4, 4, 0.05)
    np.testing.assert_allclose(scratch.step[:8], wanted, atol=1e-9)


def test_only_joints_that_leave_their_limits_are_frozen() -> None:
    vehicle, scratch = VEHICLES["ua_quad_arm4"], make_scratch()
    low, high = vehicle.joint_low, vehicle.joint_high
    joints = np.array([99.0, *(0.5 * (low + high))])  # the first number is not a joint
    joints[2], joints[3] = high[1] - 0.1, low[2] + 0.1
    scratch.step[:8], scratch.mobility[:] = [7.0, 7.0, 7.0, 7.0, 0.0, 0.2, -0.2, 0.0], 1.0
    assert freeze_at_limits(vehicle.record, scratch, joints, 1)
    np.testing.assert_array_equal(scratch.mobility[:8], [1, 1, 1, 1, 1, 0, 0, 1])
    scratch.step[:], scratch.mobility[:] = 0.0, 1.0
    assert not freeze_at_limits(vehicle.record, scratch, joints, 1)


def test_the_observer_converges_at_its_bandwidth() -> None:
    state, force, torque = (
        np.zeros(layout.CONTROLLER_STATE_SIZE),
        np.array([1.0, -2.0, 0.5]),
        np.array([0.1, 0.0, -0.2]),
    )
    bandwidth, linear, angular = 5.0, np.zeros(3), np.zeros(3)
    for _ in range(round(1.0 / bandwidth / DT)):
        linear, angular = linear + DT * force, angular + DT * torque
        observe_disturbance(state, tuple(linear), tuple(angular), (0.0,) * 3, (0.0,) * 3, bandwidth, 5.0, 5.0, DT)
    reached = 1.0 - np.exp(-1.0)  # after one time constant
    np.testing.assert_allclose(state[layout.FORCE : layout.FORCE + 3], reached * force, rtol=1e-9)
    np.testing.assert_allclose(state[layout.TORQUE : layout.TORQUE + 3], reached * torque, rtol=1e-9)


def test_the_observer_does_not_claim_more_than_its_limit() -> None:
    state, force, linear = np.zeros(layout.CONTROLLER_STATE_SIZE), np.array([3.0, -4.0, 0.0]), np.zeros(3)
    for _ in range(500):
        linear = linear + DT * force
        observe_disturbance(state, tuple(linear), (0.0,) * 3, (0.0,) * 3, (0.0,) * 3, 10.0, 2.0, 1.0, DT)
    np.testing.assert_allclose(state[layout.FORCE : layout.FORCE + 3], 2.0 * force / 5.0, rtol=1e-9)
