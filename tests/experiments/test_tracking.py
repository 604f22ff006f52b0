"""The tracking study: its motions are what they say, and it measures what it says, in a tiny setting."""

import json
from itertools import product

import numpy as np
import pytest

from aerial_il.suite.tasks.reach import TARGET_HIGH, TARGET_LOW
from experiments.common.report import Report
from experiments.tracking import study as tracking
from experiments.tracking.motions import CIRCLE_RADIUS_M, Motion, curves, poses
from experiments.tracking.study import Flights, Tracking


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Report:
    settings = Tracking(robots=("ua_quad_arm4",), tiers=("gusts",), seeds=1, settle_s=3.0, duration_s=1.0, threads=1)
    return settings.run(tmp_path_factory.mktemp("tracking"), progress=False)


def test_every_arm_has_its_row_and_every_robot_its_targets(report: Report) -> None:
    rows = report.tables["Tracking"]
    laws = ("geometric_observer", "geometric", "pid")
    assert [(row["controller"], row["reference"]) for row in rows] == list(product(laws, ("hover", "moving")))
    assert [target.limit for target in report.targets] == [0.8, 1.5, 0.8]
    assert report.targets[0].measured == rows[0]["rmse_cm"]
    json.dumps(report.to_dict(), allow_nan=False)
    assert report.figures["tracking.svg"].startswith("<?xml")


def test_the_observer_helps_the_base(report: Report) -> None:
    on, off = (report.tables["Tracking"][k] for k in (0, 2))
    assert 0.0 < on["rmse_cm"] < 3.0
    assert on["crashes"] == 0
    assert off["base_rmse_cm"] > 1.3 * on["base_rmse_cm"]


def test_statistics_of_errors_that_are_known() -> None:
    error = np.zeros((4, 2, 3))
    error[:, 0, 0], error[:, 1, 2] = 0.03, [0.01, -0.01, 0.01, -0.01]
    flights = Flights(curves(), np.array([7, 7]), error, np.zeros((4, 2)), np.zeros((4, 2)), np.zeros(2, bool))
    np.testing.assert_allclose(flights.run_rmse_m, [0.03, 0.01])
    np.testing.assert_allclose(flights.seed_rmse_m, [np.sqrt((0.03**2 + 0.01**2) / 2)])
    np.testing.assert_allclose(flights.select([False, True]).run_rmse_m, [0.01])


def test_an_observer_that_is_worth_nothing_misses_its_target() -> None:
    still = np.zeros((4, 1))
    flights = [
        Flights(curves()[:1], np.array([7]), np.zeros((4, 1, 3)), np.full((4, 1), base), still, np.zeros(1, bool))
        for base in (0.02, 0.02, 0.05)
    ]
    arms = {("quad", "gusts", "geometric_observer"): flights[0], ("quad", "gusts", "geometric"): flights[1]}
    assert [target.met for target in tracking.observer_targets(arms)] == [False]
    assert [t.met for t in tracking.observer_targets({**arms, ("quad", "gusts", "geometric"): flights[2]})] == [True]
    assert not list(tracking.observer_targets({("quad", "calm", law): f for (_, _, law), f in arms.items()}))


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
