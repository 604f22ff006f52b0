"""Solids are closed, face outwards and have the size that was asked for."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from aerial_il.presentation.studio.solids import Solid, block, disc, propeller, tube

SOLIDS = {
    "block": (block((0.1, 0.05, 0.02), 0.01), 8 * 0.1 * 0.05 * 0.02),
    "disc": (disc(0.1, 0.02, 0.002), np.pi * 0.1**2 * 0.04),
    "tube": (tube(0.3, (0.02, 0.02, 0.02)), np.pi * 0.02**2 * 0.3),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_it_is_closed_and_about_as_large_as_said(name: str) -> None:
    solid, volume = SOLIDS[name]
    assert 0.85 * volume < volume_of(solid) < volume
    assert set(edges_of(solid).values()) == {0}


@pytest.mark.parametrize("name", [*SOLIDS, "propeller"])
def test_normals_are_unit_vectors_that_point_outwards(name: str) -> None:
    solid = propeller(0.12, 2, True) if name == "propeller" else SOLIDS[name][0]
    np.testing.assert_allclose(np.linalg.norm(solid.normals, axis=1), 1.0, atol=1e-6)
    a, b, c = (solid.points[solid.faces[:, k]] for k in range(3))
    outwards = np.cross(b - a, c - a)
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    along = np.einsum("fj,fj->f", outwards, solid.normals[solid.faces].mean(axis=1))
    assert (along > 0.0).mean() > 0.98


def test_a_propeller_is_as_wide_as_its_rotor() -> None:
    one, other = propeller(0.12, 2, True), propeller(0.12, 2, False)
    assert np.linalg.norm(one.points[:, :2], axis=1).max() == pytest.approx(0.12, rel=0.02)
    np.testing.assert_allclose(one.points.mean(axis=0), 0.0, atol=1e-3)
    tilt = [np.corrcoef(s.points[s.points[:, 0] > 0, 1], s.points[s.points[:, 0] > 0, 2])[0, 1] for s in (one, other)]
    assert tilt[0] * tilt[1] < 0.0


def volume_of(solid: Solid) -> float:
    a, b, c = (solid.points[solid.faces[:, k]] for k in range(3))
    return float(np.einsum("fj,fj->", a, np.cross(b, c)) / 6.0)


def edges_of(solid: Solid) -> Counter:
    """How often each edge, told by its ends' places, is gone along one way more than the other."""
    place = {tuple(p): i for i, p in enumerate(np.round(solid.points, 9))}
    number = [place[tuple(p)] for p in np.round(solid.points, 9)]
    count: Counter = Counter()
    for face in solid.faces:
        for k in range(3):
            a, b = number[face[k]], number[face[(k + 1) % 3]]
            if a != b:
                count[min(a, b), max(a, b)] += 1 if a < b else -1
    return count
