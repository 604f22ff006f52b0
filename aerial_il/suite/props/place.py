"""Random places of things at the start of an episode."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aerial_il.suite.physics.view import View


def place(view: View, world: int, body: str, pos: np.ndarray, *, yaw: float = 0.0, pitch: float = 0.0) -> None:
    """Put a mocap body of one world at ``pos`` (3,) m, turned by ``yaw`` about z, then ``pitch`` about its y, rad."""
    mocap = view.mocap_id(body)
    c, s, cp, sp = np.cos(0.5 * yaw), np.sin(0.5 * yaw), np.cos(0.5 * pitch), np.sin(0.5 * pitch)
    view.mocap_pos[world, mocap] = pos
    view.mocap_quat[world, mocap] = [c * cp, -s * sp, c * sp, s * cp]


def two_places(
    rng: np.random.Generator,
    low: np.ndarray,
    high: np.ndarray,
    *,
    apart: float,
    workable: Callable[[np.ndarray], bool] = lambda place: True,
) -> tuple[np.ndarray, np.ndarray]:
    """Two random points (2,) between ``low`` and ``high`` (2,), at least ``apart`` from each other, all in m.

    Args:
        workable: whether a point (2,) will do.
    """
    while True:
        a, b = rng.uniform(low, high), rng.uniform(low, high)
        if np.hypot(*(a - b)) >= apart and workable(a) and workable(b):
            return a, b


def places_apart(
    rng: np.random.Generator, low: np.ndarray, high: np.ndarray, count: int, *, apart: float
) -> np.ndarray:
    """Random points (count, 2) between ``low`` and ``high`` (2,), each at least ``apart`` from all others, in m."""
    while True:
        points = rng.uniform(low, high, (count, 2))
        gaps = np.linalg.norm(points[:, None] - points[None], axis=2)
        if (gaps + 2.0 * apart * np.eye(count)).min() >= apart:
            return points
