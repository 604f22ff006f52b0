"""Puts shapes on the bodies of a scene's copy, for eyes alone: without mass, without contact."""

from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from aerial_il.presentation.studio.solids import Solid

PREFIX = "studio"  # of the names of what is added
Colour = Sequence[float]


class Workshop:
    """Adds solids to a scene, each shape made once.

    Args:
        spec: the scene, which is changed.
    """

    def __init__(self, spec: mujoco.MjSpec) -> None:
        self.spec = spec
        self._made: dict[tuple, str] = {}
        self._count = 0

    def add(
        self, body: mujoco.MjsBody, make: Callable[..., Solid], *sizes: float | tuple[float, ...], rgba: Colour,
        material: str, pos: Sequence[float] = (0.0, 0.0, 0.0), quat: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
        name: str = "",
    ) -> mujoco.MjsGeom:  # fmt: skip
        """Put the solid ``make(*sizes)`` on ``body``.

        Args:
            body: that carries it. make: of :mod:`solids`. sizes: what it is made with, m. rgba: colour.
            material: one of the stage's. pos, quat: of the solid in the body's frame, m. name: to find it by.
        """
        self._count += 1
        return body.add_geom(
            name=f"{PREFIX}_{name or self._count}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=self._mesh(make, sizes),
            pos=pos, quat=quat, rgba=rgba, material=f"{PREFIX}_{material}", contype=0, conaffinity=0, mass=0.0,
        )  # fmt: skip

    def _mesh(self, make: Callable[..., Solid], sizes: tuple) -> str:
        key = (make, sizes)
        if key not in self._made:
            name = f"{PREFIX}_{len(self._made)}"
            make(*sizes).add_to(self.spec, name)
            self._made[key] = name
        return self._made[key]


def hide(geom: mujoco.MjsGeom) -> None:
    """Leave a geom where it is and draw it no more."""
    geom.rgba = [*geom.rgba[:3], 0.0]
    geom.material = ""


def upright_along(axis: np.ndarray) -> np.ndarray:
    """Return the quaternion (4,) that turns z to ``axis`` (3,)."""
    quat = np.empty(4)
    mujoco.mju_quatZ2Vec(quat, np.asarray(axis, float) / np.linalg.norm(axis))
    return quat
