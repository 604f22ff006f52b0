"""Allocation reproduces what the rotors can give and gives up in the right order."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from aerial_il.control.allocation import FORCE_Z_AND_TORQUES, FULL_WRENCH, allocate, mixer_matrix, wrench_matrix
from aerial_il.control.vehicle import GRAVITY, Vehicle
from aerial_il.core.errors import InvalidValueError
from tests.control.nominal import VEHICLES

vehicles = st.sampled_from(list(VEHICLES.values()))
share = st.floats(-1.0, 1.0)


def wrench_of(vehicle: Vehicle, thrust: np.ndarray) -> np.ndarray:
    return wrench_matrix(vehicle.rotor_pos, vehicle.rotor_axis, vehicle.rotor_drag_ratio) @ thrust


def allocated(vehicle: Vehicle, wrench: np.ndarray) -> np.ndarray:
    thrust = np.empty(len(vehicle.rotor_max))
    allocate(vehicle.mixer, vehicle.rotor_min, vehicle.rotor_max, tuple(wrench[:3]), tuple(wrench[3:]), thrust)
    return thrust


def actuated(vehicle: Vehicle) -> list[int]:
    return list(FULL_WRENCH if vehicle.lateral_limit > 0.0 else FORCE_Z_AND_TORQUES)


@settings(deadline=None, max_examples=60)
@given(vehicles, st.lists(st.floats(0.05, 0.95), min_size=6, max_size=6))
def test_a_wrench_that_the_rotors_can_give_is_given(vehicle: Vehicle, use: list[float]) -> None:
    rows, count = actuated(vehicle), len(vehicle.rotor_max)
    wrench = wrench_of(vehicle, np.array(use[:count]) * vehicle.rotor_max)
    wanted = np.zeros(6)
    wanted[rows] = wrench[rows]
    smallest = vehicle.mixer @ wanted
    assume(((smallest >= vehicle.rotor_min) & (smallest <= vehicle.rotor_max)).all())
    np.testing.assert_allclose(allocated(vehicle, wanted), smallest, atol=1e-9)
    np.testing.assert_allclose(wrench_of(vehicle, smallest)[rows], wanted[rows], atol=1e-9)


@settings(deadline=None, max_examples=60)
@given(vehicles, st.lists(share, min_size=5, max_size=5))
def test_a_wrench_near_hover_makes_the_round_trip(vehicle: Vehicle, shares: list[float]) -> None:
    side, weight = 0.1 * vehicle.lateral_limit, vehicle.mass * GRAVITY
    tilt, turn = 0.05 * weight * np.abs(vehicle.rotor_pos).max(), 0.1 * weight * np.abs(vehicle.rotor_drag_ratio).max()
    wanted = np.insert(np.array([side, side, tilt, tilt, turn]) * shares, 2, weight)
    rows = actuated(vehicle)
    np.testing.assert_allclose(wrench_of(vehicle, allocated(vehicle, wanted))[rows], wanted[rows], atol=1e-9)


@settings(deadline=None, max_examples=100)
@given(vehicles, st.lists(st.floats(-500.0, 500.0), min_size=6, max_size=6))
def test_no_demand_exceeds_the_rotors(vehicle: Vehicle, wrench: list[float]) -> None:
    thrust = allocated(vehicle, np.array(wrench))
    assert (thrust >= vehicle.rotor_min).all()
    assert (thrust <= vehicle.rotor_max).all()


@settings(deadline=None, max_examples=60)
@given(vehicles, share, share, st.floats(0.0, 5.0), share, share, share)
def test_roll_and_pitch_are_kept_when_all_else_is_too_much(
    vehicle: Vehicle, tx: float, ty: float, lift: float, fx: float, fy: float, tz: float
) -> None:
    torque = 0.35 * vehicle.rotor_max[0] * np.abs(vehicle.rotor_pos[:, 0]).max() * np.array([tx, ty])
    wanted = np.array([200.0 * fx, 200.0 * fy, lift * vehicle.rotor_max.sum(), *torque, 50.0 * tz])
    np.testing.assert_allclose(wrench_of(vehicle, allocated(vehicle, wanted))[3:5], torque, atol=1e-9)


@settings(deadline=None, max_examples=60)
@given(vehicles, share, share, st.floats(-100.0, 100.0))
def test_yaw_is_given_up_before_lift_and_sideways_force(vehicle: Vehicle, fx: float, fy: float, tz: float) -> None:
    side = 0.5 * vehicle.lateral_limit
    wanted = np.array([side * fx, side * fy, vehicle.mass * GRAVITY, 0.0, 0.0, tz])
    rows = [row for row in actuated(vehicle) if row != 5]
    thrust = allocated(vehicle, wanted)
    got = wrench_of(vehicle, thrust)
    np.testing.assert_allclose(got[rows], wanted[rows], atol=1e-9)
    assert got[5] * tz >= -1e-9
    exhausted = np.minimum(thrust - vehicle.rotor_min, vehicle.rotor_max - thrust).min() < 1e-9
    assert got[5] == pytest.approx(tz, abs=1e-9) or (abs(got[5]) < abs(tz) and exhausted), "as much as fits"


def test_rotors_that_cannot_yaw_are_refused() -> None:
    pos = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    mixer_matrix(wrench_matrix(pos, up, np.array([0.02, -0.02, 0.02, -0.02])))
    with pytest.raises(InvalidValueError, match="drag-torque"):
        mixer_matrix(wrench_matrix(pos, up, np.full(4, 0.02)))
