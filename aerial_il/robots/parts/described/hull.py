"""Convex hulls of meshes: how much of its own a mesh fills, and one of few points for a mesh that is too fine."""

from __future__ import annotations

import numpy as np

POINTS = 256  # of a hull of few points


def share(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Volume of a closed mesh over that of its convex hull: 1 where it is convex.

    Args:
        vertices: (V, 3) m. faces: (F, 3) indices.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(vertices).volume
    except QhullError:  # flat: it has no volume to lose
        return 1.0
    a, b, c = (vertices[faces[:, k]] - vertices.mean(axis=0) for k in range(3))
    return float(abs(np.sum(a * np.cross(b, c))) / 6.0 / hull)


def of_few_points(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the hull of the points that reach farthest in 256 directions.

    The directions are spread evenly over the sphere once length, width and height are made equal.

    Args:
        vertices: (V, 3) m.

    Returns:
        vertices: (W, 3) m, W at most 256, and faces (F, 3), counter-clockwise seen from outside.
    """
    from scipy.spatial import ConvexHull, QhullError

    size = np.ptp(vertices, axis=0)
    square = vertices / np.where(size > 0.0, size, 1.0)  # as long as wide, or the far ends would get few points
    points = vertices[np.unique([int(np.argmax(square @ direction)) for direction in _directions()])]
    try:
        hull = ConvexHull(points)
    except QhullError:  # flat: joggled, it has two sides
        hull = ConvexHull(points, qhull_options="QJ")
    a, b, c = (points[hull.simplices[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    faces = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
    used, faces = np.unique(faces, return_inverse=True)
    return points[used], faces.reshape(-1, 3)


def _directions() -> np.ndarray:
    """(256, 3) unit vectors on a spiral of the golden angle."""
    k = np.arange(POINTS) + 0.5
    height, turn = 1.0 - 2.0 * k / POINTS, np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - height**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)
