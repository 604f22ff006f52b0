"""Objects that several tasks share, made of primitives."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import WORLD

TABLE_HEIGHT_M = 0.4
CUBE_HALF_M = 0.02
CUBE_MASS_KG = 0.1
BOWL_RADIUS_M, BOWL_WALL_M = 0.07, 0.035
GRASPABLE = {
    "friction": [1.2, 0.02, 0.001],
    "solref": [0.01, 1.0],
    "solimp": [0.95, 0.99, 0.001, 0.5, 2.0],
    "condim": 4,
}

BOX, CYLINDER = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER


def add_table(spec: mujoco.MjSpec, half_width: float = 0.40, half_length: float = 0.50) -> None:
    """A table top at ``TABLE_HEIGHT_M`` around the origin, on one post; half sizes along x and y, m."""
    top = [half_width, half_length, 0.015]
    centre, wood = [0, 0, TABLE_HEIGHT_M - 0.015], [0.78, 0.68, 0.55, 1]
    spec.worldbody.add_geom(name="table", type=BOX, pos=centre, size=top, rgba=wood, **WORLD)
    post = [0.06, 0.5 * TABLE_HEIGHT_M - 0.015, 0]
    foot, grey = [0, 0, post[1]], [0.45, 0.42, 0.40, 1]
    spec.worldbody.add_geom(name="table_post", type=CYLINDER, pos=foot, size=post, rgba=grey, **WORLD)


def add_cube(spec: mujoco.MjSpec) -> None:
    """A free cube ``cube`` of 4 cm and 100 g."""
    body = spec.worldbody.add_body(name="cube")
    body.add_freejoint(name="cube")
    look = {"size": [CUBE_HALF_M] * 3, "rgba": [0.95, 0.45, 0.12, 1]}
    body.add_geom(name="cube", type=BOX, mass=CUBE_MASS_KG, **look, **WORLD, **GRASPABLE)
    body.add_site(name="cube", size=[0.003] * 3, group=4)


def add_bowl(spec: mujoco.MjSpec) -> None:
    """A bowl ``bowl`` with eight flat walls, fixed in the air or on a table: a mocap body, origin at its underside."""
    body = spec.worldbody.add_body(name="bowl", mocap=True)
    colour = [0.22, 0.42, 0.72, 1]
    body.add_geom(
        name="bowl_floor", type=CYLINDER, pos=[0, 0, 0.004], size=[BOWL_RADIUS_M, 0.004, 0], rgba=colour, **WORLD
    )
    for i, angle in enumerate(np.arange(8) * np.pi / 4):
        c, s = np.cos(angle), np.sin(angle)
        pos = [BOWL_RADIUS_M * c, BOWL_RADIUS_M * s, 0.5 * BOWL_WALL_M]
        size = [0.004, BOWL_RADIUS_M * np.tan(np.pi / 8), 0.5 * BOWL_WALL_M]
        quat = [np.cos(0.5 * angle), 0, 0, np.sin(0.5 * angle)]
        body.add_geom(name=f"bowl_wall_{i}", type=BOX, pos=pos, quat=quat, size=size, rgba=colour, **WORLD)
    body.add_site(name="bowl", size=[0.003] * 3, group=4)
