"""Marks in a picture: trails of where something was, arrows for wind and force, ghosts of earlier moments."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import mujoco
import numpy as np

from aerial_il.presentation.studio.stage import HORIZON
from aerial_il.suite.physics.physics_batch import STATE

Colour = tuple[float, float, float]
SEGMENTS, SHORTEST_M = 60, 1e-5  # of a trail, at most; shorter ones are left out
FAINTEST = 0.15  # opacity of a trail's oldest end
HEAD_SHARE, LONGEST_HEAD_M = 0.35, 0.06  # of an arrow


class Mark(Protocol):
    """Something drawn into a scene beside what is there."""

    def add_to(self, scene: mujoco.MjvScene, model: mujoco.MjModel) -> None:
        """Add its geoms to ``scene``, which shows a state of ``model``."""
        ...


@dataclass(frozen=True, eq=False)
class Trail:
    """A line through ``points`` (N, 3) m, oldest first and faintest; ``radius`` m."""

    points: np.ndarray
    colour: Colour
    radius: float = 0.004

    def add_to(self, scene: mujoco.MjvScene, model: mujoco.MjModel) -> None:
        stride = max(1, len(self.points) // SEGMENTS)
        ends = np.concatenate([self.points[:-1:stride], self.points[-1:]])
        for k, (start, end) in enumerate(pairwise(ends)):
            if float(np.linalg.norm(end - start)) > SHORTEST_M:
                rgba = (*self.colour, FAINTEST + (1.0 - FAINTEST) * (k + 1) / (len(ends) - 1))
                _connect(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, self.radius, start, end, rgba)


@dataclass(frozen=True, eq=False)
class Arrow:
    """An arrow from ``start`` (3,) along ``vector`` (3,), both m, world."""

    start: np.ndarray
    vector: np.ndarray
    colour: Colour
    radius: float = 0.007

    def add_to(self, scene: mujoco.MjvScene, model: mujoco.MjModel) -> None:
        length = float(np.linalg.norm(self.vector))
        if length < 2.0 * self.radius:
            return
        head = min(LONGEST_HEAD_M, HEAD_SHARE * length)
        neck = self.start + self.vector * (1.0 - head / length)
        rgba = (*self.colour, 1.0)
        _connect(scene, mujoco.mjtGeom.mjGEOM_CYLINDER, self.radius, self.start, neck, rgba)
        for k in range(6):  # a cone of ever thinner slices
            low, high = (neck + self.vector * head / length * share for share in (k / 6, (k + 1) / 6))
            _connect(scene, mujoco.mjtGeom.mjGEOM_CYLINDER, 2.4 * self.radius * (1.0 - (k + 0.5) / 6), low, high, rgba)


@dataclass(frozen=True, eq=False)
class Ghost:
    """The robot, and whatever flies freely, in another ``state`` (S,), the paler the larger ``fade`` in [0, 1]."""

    state: np.ndarray
    fade: float

    def add_to(self, scene: mujoco.MjvScene, model: mujoco.MjModel) -> None:
        data, before = mujoco.MjData(model), scene.ngeom
        mujoco.mj_setState(model, data, self.state, STATE)
        mujoco.mj_forward(model, data)
        mujoco.mjv_addGeoms(model, data, mujoco.MjvOption(), mujoco.MjvPerturb(), mujoco.mjtCatBit.mjCAT_DYNAMIC, scene)
        shown = free_geoms(model)
        for k in range(before, scene.ngeom):
            geom = scene.geoms[k]
            if geom.objtype != mujoco.mjtObj.mjOBJ_GEOM or not shown[geom.objid]:
                geom.rgba[3] = 0.0
            else:
                geom.rgba[:3] += self.fade * (np.array(HORIZON, np.float32) - geom.rgba[:3])


def free_geoms(model: mujoco.MjModel) -> np.ndarray:
    """Return (G,) bool: the geom belongs to something that flies freely, as robots and objects do."""
    free = set(model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE].tolist())
    base = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "base")
    roots = free | ({int(model.body_rootid[base])} if base >= 0 else set())
    return np.isin(model.body_rootid[model.geom_bodyid], sorted(roots))


def _connect(
    scene: mujoco.MjvScene, kind: mujoco.mjtGeom, radius: float, start: np.ndarray, end: np.ndarray,
    rgba: Sequence[float],
) -> None:  # fmt: skip
    if scene.ngeom >= scene.maxgeom:
        return
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), np.array(rgba, np.float32))
    mujoco.mjv_connector(geom, kind, radius, np.asarray(start, float), np.asarray(end, float))
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR
    scene.ngeom += 1
