"""A bowl to put things into."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import WORLD
from aerial_il.suite.props.contact import HARD

BOWL_RADIUS_M, BOWL_WALL_M, HALF_WALL_M = 0.07, 0.035, 0.004  # to the middle of a wall; its height, half its thickness
BLUE = [0.22, 0.42, 0.72, 1]


def add_bowl(
    spec: mujoco.MjSpec,
    name: str = "bowl",
    *,
    radius: float = BOWL_RADIUS_M,
    wall: float = BOWL_WALL_M,
    half_floor: float = HALF_WALL_M,
) -> mujoco.MjsBody:
    """A bowl with eight flat walls, fixed in the air or on a table: a mocap body ``name``, origin at its underside.

    Its octagonal floor is made of four oblongs: of a cube in a cylinder, MuJoCo at times finds that it is to leave
    sideways through the wall.

    Args:
        radius: from the axis to the middle of a wall, m. wall: its height, m.
        half_floor: half the floor's thickness, m.
    """
    body = spec.worldbody.add_body(name=name, mocap=True)
    half_side, inside = radius * np.tan(np.pi / 8), radius - HALF_WALL_M
    for i in range(8):
        _add_part(body, f"{name}_wall_{i}", i, radius, [HALF_WALL_M, half_side, 0.5 * wall])
    for i in range(4):
        _add_part(body, f"{name}_floor_{i}", i, 0.0, [inside, inside * np.tan(np.pi / 8), half_floor])
    body.add_site(name=name, size=[0.003] * 3, group=4)
    return body


def _add_part(bowl: mujoco.MjsBody, name: str, eighth: int, away: float, size: list[float]) -> None:
    """Add a box that stands on the bowl's underside, turned by ``eighth`` eighths and ``away`` m from the axis."""
    angle = eighth * np.pi / 4
    pos = [away * np.cos(angle), away * np.sin(angle), size[2]]
    look = {"pos": pos, "quat": [np.cos(0.5 * angle), 0, 0, np.sin(0.5 * angle)], "size": size, "rgba": BLUE}
    bowl.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, **look, **WORLD, **HARD)
