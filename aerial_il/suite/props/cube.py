"""A cube to be picked up."""

from __future__ import annotations

import mujoco

from aerial_il.robots.parts.collision import WORLD
from aerial_il.suite.props.contact import GRASPABLE

CUBE_HALF_M = 0.02
CUBE_MASS_KG = 0.1


def add_cube(spec: mujoco.MjSpec) -> None:
    """A free cube ``cube`` of 4 cm and 100 g."""
    body = spec.worldbody.add_body(name="cube")
    body.add_freejoint(name="cube")
    look = {"size": [CUBE_HALF_M] * 3, "rgba": [0.95, 0.45, 0.12, 1]}
    body.add_geom(name="cube", type=mujoco.mjtGeom.mjGEOM_BOX, mass=CUBE_MASS_KG, **look, **WORLD, **GRASPABLE)
    body.add_site(name="cube", size=[0.003] * 3, group=4)
