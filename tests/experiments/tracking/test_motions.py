"""Reference motions: constant speed, closed, right-handed."""

from __future__ import annotations

import numpy as np
import pytest

from aerial_il.suite.tasks.reach import TARGET_HIGH, TARGET_LOW
from experiments.tracking.motions import CIRCLE_RADIUS_M, Motion, curves, poses

SPEED_M_S = 0.2
TIMES_S = np.arange(0.0, 15.0, 0.02)
EVERY = pytest.mark.parametrize("motion", [*poses(), *curves()], ids=lambda motion: motion.name)


@pytest.mark.parametrize("motion", curves(), ids=lambda motion: motion.name)
def test_a_curve_is_flown_at_constant_speed(motion: Motion) -> None:
    path = motion.positions(TIMES_S, SPEED_M_S)
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) / 0.02
    np.testing.assert_allclose(speed, SPEED_M_S, rtol=0.02)
    np.testing.assert_array_equal(path[0], motion.curve[0])


def test_the_circle_closes_after_its_circumference() -> None:
    circle = curves()[0]
    lap_s = 2.0 * np.pi * CIRCLE_RADIUS_M / SPEED_M_S
    np.testing.assert_allclose(circle.positions(np.array([lap_s]), SPEED_M_S), circle.curve[:1], atol=1e-4)


def test_the_curves_exercise_all_axes() -> None:
    spans = np.max([np.ptp(motion.curve, axis=0) for motion in curves()], axis=0)
    assert (spans >= 0.25).all()


@EVERY
def test_references_stay_where_reach_has_its_targets(motion: Motion) -> None:
    path = motion.positions(TIMES_S, SPEED_M_S)
    assert (path >= TARGET_LOW).all()
    assert (path <= TARGET_HIGH).all()


@EVERY
def test_the_orientation_points_down_by_the_pitch(motion: Motion) -> None:
    x, y = motion.rot6d[:3], motion.rot6d[3:]
    np.testing.assert_allclose([x @ x, y @ y, x @ y], [1.0, 1.0, 0.0], atol=1e-12)
    assert np.isclose(np.arcsin(-x[2]), motion.pitch_rad)
    assert y[2] == 0.0
