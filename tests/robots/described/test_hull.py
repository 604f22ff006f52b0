"""Hulls of few points: how near to the whole mesh, how many, and which way their faces look."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from aerial_il.robots.parts.described import hull, model
from aerial_il.robots.parts.described.arm import read_arm
from tests.robots.described.test_refused import mesh
from tests.robots.described.writing import stl


def blob(count: int) -> np.ndarray:
    """Points (count, 3) on an ellipsoid of half sizes 5, 2 and 1 cm, m."""
    points = np.random.default_rng(0).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True) * [0.05, 0.02, 0.01]


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Signed volume of a closed mesh, m³: positive if its faces are counter-clockwise seen from outside."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6.0)


def test_a_hull_of_few_points_is_nearly_whole_and_faces_out() -> None:
    fine = blob(20_000)
    vertices, faces = hull.of_few_points(fine)
    assert 100 < len(vertices) <= hull.POINTS
    assert 0.95 * ConvexHull(fine).volume < volume(vertices, faces) < ConvexHull(fine).volume
    np.testing.assert_allclose(np.ptp(vertices, axis=0), np.ptp(fine, axis=0), rtol=0.02)


def test_a_flat_mesh_has_a_hull_too() -> None:
    vertices, faces = hull.of_few_points(blob(1000) * [1.0, 1.0, 0.0])
    assert len(faces) > 2
    assert np.all(vertices[:, 2] == 0.0)


def test_meshes_as_fine_as_manufacturers_make_them_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fine = blob(3000)
    (tmp_path / "lower.stl").write_bytes(stl(fine, [tuple(face) for face in ConvexHull(fine).simplices]))
    (tmp_path / "arm.urdf").write_text(mesh("lower.stl"), encoding="utf-8")
    whole = read_arm(tmp_path / "arm.urdf").arm.links[1].shapes
    monkeypatch.setattr(model, "MOST_VERTICES", 2000)
    found = read_arm(tmp_path / "arm.urdf")
    assert sum(len(shape.vertices) for shape in found.arm.links[1].shapes) <= hull.POINTS
    assert any("its meshes have 3000 vertices" in note for note in found.notes)
    sizes = [np.sort(shape.half_extent) for shape in (*whole, *found.arm.links[1].shapes)]
    np.testing.assert_allclose(sizes[0], sizes[-1], rtol=0.05)
