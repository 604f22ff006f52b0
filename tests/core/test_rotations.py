"""Rotations: round trips, and agreement with MuJoCo's own functions."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerial_il.core.rotations import (
    mat_from_axis_angle,
    mat_from_quat,
    mat_from_rot6d,
    mat_from_rotvec,
    mat_from_yaw,
    matmul,
    matmul_back,
    orthonormalise,
    rot6d_from_mat,
    rotate,
    rotate_back,
    rotvec_from_mat,
    wrap_angle,
)

numbers = st.floats(-3.0, 3.0)
vectors = st.tuples(numbers, numbers, numbers)
quick = settings(deadline=None, max_examples=60)


def matrix(m: tuple[float, ...]) -> np.ndarray:
    return np.reshape(m, (3, 3))


@quick
@given(st.tuples(numbers, numbers, numbers, numbers).filter(lambda q: np.linalg.norm(q) > 1e-3))
def test_quaternions_are_mujocos(q: tuple[float, ...]) -> None:
    unit = np.array(q) / np.linalg.norm(q)
    theirs = np.empty(9)
    mujoco.mju_quat2Mat(theirs, unit)
    np.testing.assert_allclose(mat_from_quat(tuple(unit)), theirs, atol=1e-12)


@quick
@given(vectors)
def test_rotation_vectors_make_the_round_trip(v: tuple[float, ...]) -> None:
    rot = mat_from_rotvec(v)
    np.testing.assert_allclose(matrix(rot) @ matrix(rot).T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(matrix(mat_from_rotvec(rotvec_from_mat(rot))), matrix(rot), atol=1e-6)
    if np.linalg.norm(v) < np.pi - 1e-3:
        np.testing.assert_allclose(rotvec_from_mat(rot), v, atol=1e-6)


@pytest.mark.parametrize("axis", np.vstack([np.eye(3), [[0.6, 0.0, 0.8], [-0.6, 0.8, 0.0]]]))
def test_half_a_turn_is_found(axis: np.ndarray) -> None:
    result = np.array(rotvec_from_mat(mat_from_axis_angle(tuple(axis), np.pi)))
    assert np.linalg.norm(result) == pytest.approx(np.pi)
    np.testing.assert_allclose(np.abs(result @ axis), np.pi)


@quick
@given(vectors, vectors, vectors)
def test_products_and_their_inverses(a: tuple[float, ...], b: tuple[float, ...], v: tuple[float, ...]) -> None:
    ra, rb = mat_from_rotvec(a), mat_from_rotvec(b)
    np.testing.assert_allclose(matrix(matmul(ra, rb)), matrix(ra) @ matrix(rb), atol=1e-12)
    np.testing.assert_allclose(matrix(matmul_back(ra, rb)), matrix(ra).T @ matrix(rb), atol=1e-12)
    np.testing.assert_allclose(rotate(ra, v), matrix(ra) @ v, atol=1e-12)
    np.testing.assert_allclose(rotate_back(ra, rotate(ra, v)), v, atol=1e-12)


@quick
@given(vectors)
def test_rot6d_makes_the_round_trip(v: tuple[float, ...]) -> None:
    rots = np.stack([matrix(mat_from_rotvec(v)), np.eye(3)])
    np.testing.assert_allclose(mat_from_rot6d(rot6d_from_mat(rots)), rots, atol=1e-12)
    np.testing.assert_array_equal(rot6d_from_mat(rots.reshape(2, 9)), rot6d_from_mat(rots))
    np.testing.assert_array_equal(rot6d_from_mat(rots)[0], np.concatenate([rots[0, :, 0], rots[0, :, 1]]))


@quick
@given(vectors, vectors)
def test_any_two_vectors_become_a_rotation(x: tuple[float, ...], y: tuple[float, ...]) -> None:
    rot = matrix(orthonormalise(x, y))
    np.testing.assert_allclose(rot @ rot.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rot) == pytest.approx(1.0)


@quick
@given(st.floats(-20.0, 20.0))
def test_angles_are_wrapped(angle: float) -> None:
    assert -np.pi <= wrap_angle(angle) <= np.pi
    np.testing.assert_allclose(mat_from_yaw(wrap_angle(angle)), mat_from_yaw(angle), atol=1e-12)
