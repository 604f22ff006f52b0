"""What reach pays for a pose that was reached, for one within a share of its tolerance, and for one on the way."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from aerial_il.suite.episode import measured
from aerial_il.suite.tasks import reach
from aerial_il.suite.tasks.reach import ANGLE_TOLERANCE_RAD, POSITION_TOLERANCE_M, TASK, reached
from tests.contract.registered import batch

HERE = np.array([[0.1, 0.2, 0.9, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]])


def turned(axis: int, angle_rad: float) -> np.ndarray:
    """Return the pose turned about one of its axes."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[i, i], rotation[i, j], rotation[j, i], rotation[j, j] = c, -s, s, c
    return np.concatenate([HERE[:, :3], rotation[:, 0][None], rotation[:, 1][None]], axis=1)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("share", [1.0, 0.5, 0.1])
def test_the_angle_that_passes_is_that_share_about_every_axis(axis: int, share: float) -> None:
    for factor, paid in ((0.99, 1.0), (1.01, 0.0)):
        pose = turned(axis, factor * share * ANGLE_TOLERANCE_RAD)
        assert reached(pose, HERE, share) == paid


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_the_distance_that_passes_is_that_share(share: float) -> None:
    for factor, paid in ((0.99, 1.0), (1.01, 0.0)):
        moved = HERE.copy()
        moved[:, 1] += factor * share * POSITION_TOLERANCE_M
        assert reached(moved, HERE, share) == paid


def test_the_task_tells_how_to_be_stricter() -> None:
    assert TASK.goal is not None
    assert TASK.goal.within is reached


def dense(away_m: np.ndarray, turned_deg: np.ndarray) -> np.ndarray:
    """Return the dense reward, (n,), of tools ``away_m`` from their targets and ``turned_deg`` from their attitude."""
    worlds = batch("z1", "reach", num_envs=len(away_m))
    worlds.reset(0)
    view = worlds.simulation.view
    target, tool = view.mocap_id("target"), np.array(view.tool_mat)
    view.mocap_pos[:, target] = view.tool_pos + np.stack([away_m, 0 * away_m, 0 * away_m], axis=1)
    for world, angle in enumerate(np.deg2rad(turned_deg)):
        quat, turn = np.empty(4), np.array([math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)])
        mujoco.mju_mat2Quat(quat, tool[world])
        mujoco.mju_mulQuat(view.mocap_quat[world, target], quat, turn)
    worlds.set_state(worlds.get_state())
    np.testing.assert_allclose(measured.number(reach.cosine)(view), np.cos(np.deg2rad(turned_deg)), atol=1e-6)
    return measured.number(reach.reward)(view)


def test_the_dense_reward_pays_for_the_last_degrees() -> None:
    degrees = np.array([0.0, 10.0, 20.0, 45.0, 90.0])
    by_angle = dense(np.zeros(5), degrees)
    assert by_angle[0] == pytest.approx(1.0)
    assert (np.diff(by_angle) < -0.05).all(), "each of these pays"
    by_distance = dense(np.array([0.0, 0.02, 0.04, 0.3, 0.6]), np.zeros(5))
    assert (np.diff(by_distance) < -0.05).all()
