"""A bowl to put things into."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import WORLD

BOWL_RADIUS_M, BOWL_WALL_M = 0.07, 0.035


def add_bowl(spec: mujoco.MjSpec) -> None:
    """A bowl ``bowl`` with eight flat walls, fixed in the air or on a table: a mocap body, origin at its underside."""
    box, cylinder = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
    body = spec.worldbody.add_body(name="bowl", mocap=True)
    colour = [0.22, 0.42, 0.72, 1]
    body.add_geom(
        name="bowl_floor", type=cylinder, pos=[0, 0, 0.004], size=[BOWL_RADIUS_M, 0.004, 0], rgba=colour, **WORLD
    )
    for i, angle in enumerate(np.arange(8) * np.pi / 4):
        c, s = np.cos(angle), np.sin(angle)
        pos = [BOWL_RADIUS_M * c, BOWL_RADIUS_M * s, 0.5 * BOWL_WALL_M]
        size = [0.004, BOWL_RADIUS_M * np.tan(np.pi / 8), 0.5 * BOWL_WALL_M]
        quat = [np.cos(0.5 * angle), 0, 0, np.sin(0.5 * angle)]
        body.add_geom(name=f"bowl_wall_{i}", type=box, pos=pos, quat=quat, size=size, rgba=colour, **WORLD)
    body.add_site(name="bowl", size=[0.003] * 3, group=4)
