"""The way between two segments: straight, or over what stands in between."""

from collections.abc import Collection
from dataclasses import dataclass

import mujoco
import numpy as np

CLEARANCE_M = 0.05  # from a tool on its way to what it could hit
NEAR_ENDS_M = 0.15  # of a way: there a tool comes close to what it deals with
STEP_M = 0.02  # between points of a way that are looked at


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes about G solid geoms, as they are at one instant.

    Attributes:
        center: (G, 3) m, world. mat: (G, 3, 3) world from box. half: (G, 3) m. root: (G,) topmost body of each.
    """

    center: np.ndarray
    mat: np.ndarray
    half: np.ndarray
    root: np.ndarray

    def apart(self, points: np.ndarray) -> np.ndarray:
        """Return how far (K, G) m ``points`` (K, 3) are from each box; 0 inside."""
        inside = np.einsum("gji,kgj->kgi", self.mat, points[:, None] - self.center)
        return np.linalg.norm(np.maximum(np.abs(inside) - self.half, 0.0), axis=2)

    def tops(self) -> np.ndarray:
        """Return the height (G,) m of each."""
        return self.center[:, 2] + np.einsum("gi,gi->g", np.abs(self.mat[:, 2]), self.half)


def boxes(model: mujoco.MjModel, data: mujoco.MjData) -> Boxes:
    """Return the boxes about what is solid in a scene whose kinematics are up to date, planes excepted."""
    root = model.body_rootid[model.geom_bodyid]
    solid = (model.geom_contype | model.geom_conaffinity) != 0
    chosen = np.flatnonzero(solid & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE))
    mats = data.geom_xmat[chosen].reshape(-1, 3, 3)
    offset, half = model.geom_aabb[chosen, :3], model.geom_aabb[chosen, 3:]
    centers = data.geom_xpos[chosen] + np.einsum("gij,gj->gi", mats, offset)
    return Boxes(centers, mats, half.copy(), root[chosen])


def way(start: np.ndarray, goal: np.ndarray, around: Boxes, spared: Collection[int]) -> list[np.ndarray]:
    """Return the points (3,) that a tool is to pass on its way, the last of which is ``goal``.

    Args:
        start, goal: (3,) m, world. around: what could be hit. spared: topmost bodies that do not count: the robot,
            what is carried, and what the tool is going to.
    """
    counted = ~np.isin(around.root, list(spared))
    tops, height = around.tops() + CLEARANCE_M, max(start[2], goal[2])
    hit = _hit(_between(start, goal, NEAR_ENDS_M), around) & counted
    found = [goal]
    while hit.any():
        height = max(height, float(tops[hit].max()))
        rise, sink = np.array([*start[:2], height]), np.array([*goal[:2], height])
        hit = _hit(_between(rise, sink, 0.0), around) & counted & (tops > height)
        found = [rise, sink, goal]
    return found


def _between(start: np.ndarray, goal: np.ndarray, ends: float) -> np.ndarray:
    """Return points (K, 3) on a straight way, but for so many metres at its ends."""
    length = float(np.linalg.norm(goal - start))
    along = np.arange(ends, length - ends, STEP_M)
    return start + along[:, None] * (goal - start) / max(length, STEP_M)


def _hit(points: np.ndarray, around: Boxes) -> np.ndarray:
    """Return which boxes (G,) bool come too near to some of the points."""
    return np.any(around.apart(points) < CLEARANCE_M, axis=0)
