"""A table."""

from __future__ import annotations

import mujoco

from aerial_il.robots.parts.collision import WORLD
from aerial_il.suite.props.contact import HARD

TABLE_HEIGHT_M = 0.4
TABLE_HALF_WIDTH_M, TABLE_HALF_LENGTH_M = 0.40, 0.50  # along x and y
TABLE_HALF_THICKNESS_M = 0.05  # in one step a peg that lands spinning gets 3 cm into it; it must come out on top
FALLEN_M = 0.1  # below its surface: what is there, and not in a gripper, has fallen off


def add_table(spec: mujoco.MjSpec) -> None:
    """A table top at ``TABLE_HEIGHT_M`` around the origin, on one post."""
    box, cylinder = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
    top = [TABLE_HALF_WIDTH_M, TABLE_HALF_LENGTH_M, TABLE_HALF_THICKNESS_M]
    centre, wood = [0, 0, TABLE_HEIGHT_M - TABLE_HALF_THICKNESS_M], [0.78, 0.68, 0.55, 1]
    spec.worldbody.add_geom(name="table", type=box, pos=centre, size=top, rgba=wood, **WORLD, **HARD)
    post = [0.06, 0.5 * TABLE_HEIGHT_M - TABLE_HALF_THICKNESS_M, 0]
    foot, grey = [0, 0, post[1]], [0.45, 0.42, 0.40, 1]
    spec.worldbody.add_geom(name="table_post", type=cylinder, pos=foot, size=post, rgba=grey, **WORLD, **HARD)
