"""A cube to be picked up."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from aerial_il.robots.parts.collision import WORLD
from aerial_il.suite.props.contact import GRASPABLE

CUBE_HALF_M = 0.02
CUBE_MASS_KG = 0.1
ORANGE = (0.95, 0.45, 0.12, 1.0)


def add_cube(spec: mujoco.MjSpec, name: str = "cube", rgba: Sequence[float] = ORANGE) -> None:
    """A free cube ``name`` of 4 cm and 100 g."""
    body = spec.worldbody.add_body(name=name)
    body.add_freejoint(name=name)
    look = {"size": [CUBE_HALF_M] * 3, "rgba": rgba}
    body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, mass=CUBE_MASS_KG, **look, **WORLD, **GRASPABLE)
    body.add_site(name=name, size=[0.003] * 3, group=4)
