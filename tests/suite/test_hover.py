"""What counts as settled, in still air and in wind."""

from __future__ import annotations

import numpy as np
import pytest

from aerial_il.control.vehicle import GRAVITY
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.episode import measured
from aerial_il.suite.tasks import hover
from tests.contract.registered import batch

CELL = ("quad", "hover")
attitude_cosine = measured.number(hover.attitude_cosine)


def test_it_starts_off_the_point_moving_leaning_and_turning() -> None:
    worlds = batch(*CELL, num_envs=16)
    obs = worlds.reset(0)
    distance = np.linalg.norm(obs["base_to_target"], axis=1)
    assert (hover.STEP_M[0] - 1e-9 <= distance).all()
    assert (distance <= hover.STEP_M[1] + 1e-9).all()
    lean = np.arccos(worlds.simulation.view.base_mat[:, 8])
    assert hover.TILT_RAD / 2 < lean.max() <= hover.TILT_RAD
    assert hover.SPEED_M_S / 2 < np.linalg.norm(obs["base_vel"], axis=1).max() <= hover.SPEED_M_S
    assert hover.RATE_RAD_S / 2 < np.linalg.norm(obs["base_angvel"], axis=1).max() <= hover.RATE_RAD_S


def put_at_target(worlds: BatchEnvironment, yaw_deg: float = 0.0, lean_deg: float = 0.0) -> None:
    """Put every base at rest on its target, ``yaw_deg`` off the heading asked for and leaning forward."""
    view = worlds.simulation.view
    ahead = view.site_mat("target")
    half_yaw = 0.5 * (np.arctan2(ahead[:, 3], ahead[:, 0]) + np.deg2rad(yaw_deg))
    half_lean = 0.5 * np.deg2rad(lean_deg)
    (cy, sy), (cl, sl) = ((np.cos(half), np.sin(half)) for half in (half_yaw, half_lean))
    view.qpos[:, :3] = view.site_pos("target")
    view.qpos[:, 3:7] = np.stack([cy * cl, -sy * sl, cy * sl, sy * cl], axis=1)
    view.qvel[:] = 0.0
    worlds.set_state(worlds.get_state())


@pytest.mark.parametrize(
    ("yaw_deg", "lean_deg", "settled"),
    [(0.0, 0.0, True), (2.5, 0.0, True), (0.0, 2.5, True), (3.5, 0.0, False), (0.0, 3.5, False), (2.5, 2.5, False)],
)
def test_attitude_is_heading_and_tilt(yaw_deg: float, lean_deg: float, settled: bool) -> None:
    worlds = batch(*CELL)
    worlds.reset(3)
    put_at_target(worlds, yaw_deg, lean_deg)
    angle = np.degrees(np.arccos(attitude_cosine(worlds.simulation.view)))
    np.testing.assert_allclose(angle, np.hypot(yaw_deg, lean_deg), atol=0.01)
    assert (worlds.simulation.reassess().subtasks[:, 3] == settled).all()


def test_in_wind_the_trimmed_attitude_leans_against_it() -> None:
    worlds = batch(*CELL)
    worlds.reset(3)
    put_at_target(worlds)
    view = worlds.simulation.view
    view.air_force[:, 1] = 0.1 * view.robot.vehicle.mass * GRAVITY
    angle = np.arccos(attitude_cosine(view))
    np.testing.assert_allclose(angle, np.arctan(0.1), atol=1e-6)
