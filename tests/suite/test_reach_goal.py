"""What reach pays for a pose that was reached, and for one within a share of its tolerance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from aerial_il.suite.tasks.reach import ANGLE_TOLERANCE_RAD, POSITION_TOLERANCE_M, TASK, reached

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
