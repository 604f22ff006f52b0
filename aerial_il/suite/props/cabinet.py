"""A low cabinet that stands on a table: its door is its front and its top, a hood that swings away in one piece."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import FIXTURE, NOTHING
from aerial_il.suite.props.contact import HARD
from aerial_il.suite.props.door import BOARD_M, BODY, DEPTH_M, LEAF, LEAF_M, STEEL, WIDTH_M, add_handle, hang_leaf
from aerial_il.suite.props.peg import UNSEEN

WALL_M = 0.13  # height of the walls over the table
FLOOR_M = 2.0 * BOARD_M  # of what lies in it, over the table
LEAF_LOW_M, HOOD_M = 0.008, WALL_M + 0.008  # lower edge of the door and middle of its top, over the table
HANDLE_HEIGHT_M = WALL_M - 0.015
HOOD_FROM_HINGE_M = 0.06  # the top begins here: nearer to the hinge it would still cover the inside of an open cabinet
HALF_BAR_M, BAR_EVERY_M = 0.003, 0.035  # of grilles: no finger and no cube goes through
INSIDE_M = np.array([DEPTH_M - FLOOR_M, WIDTH_M - 2.0 * FLOOR_M])  # from front to back, from side to side
LEAF_KG, HOOD_KG = 0.5, 0.25


def add_cabinet(spec: mujoco.MjSpec) -> None:
    """A mocap body ``cabinet``, origin under the middle of its front, with joint ``door`` (rad): opens towards +x.

    Sites ``door`` and ``loop`` are those of :func:`aerial_il.suite.props.door.add_door`. Walls and top are grilles,
    through which cameras see and nothing passes: for contacts each is a board.
    """
    cabinet = spec.worldbody.add_body(name="cabinet", mocap=True)
    cabinet.add_site(name="door", pos=[0, 0.5 * LEAF_M, HANDLE_HEIGHT_M], size=[0.003] * 3, group=4)
    x, y, z = 0.5 * DEPTH_M, 0.5 * WIDTH_M, 0.5 * WALL_M
    box = mujoco.mjtGeom.mjGEOM_BOX
    floor = {"pos": [-x, 0, BOARD_M], "size": [x, y, BOARD_M], "rgba": BODY}
    cabinet.add_geom(name="cabinet_bottom", type=box, **floor, **FIXTURE, **HARD)
    for name, side in (("left", y - BOARD_M), ("right", BOARD_M - y)):
        _add_grille(cabinet, f"cabinet_{name}", [-x, side, z], [x, BOARD_M, z])
    _add_grille(cabinet, "cabinet_back", [-DEPTH_M + BOARD_M, 0, z], [BOARD_M, y, z])
    leaf = hang_leaf(cabinet)
    half = [BOARD_M, 0.5 * LEAF_M, 0.5 * (WALL_M - LEAF_LOW_M)]
    middle = [BOARD_M, -half[1], LEAF_LOW_M + half[2]]
    leaf.add_geom(name="door_leaf", type=box, pos=middle, size=half, rgba=LEAF, mass=LEAF_KG, **FIXTURE, **HARD)
    across = 0.5 * (LEAF_M - HOOD_FROM_HINGE_M)
    hood = [0.5 * DEPTH_M - BOARD_M, across, BOARD_M]
    _add_grille(leaf, "door_hood", [-hood[0], -HOOD_FROM_HINGE_M - across, HOOD_M], hood, mass=HOOD_KG)
    add_handle(leaf, HANDLE_HEIGHT_M)


def _add_grille(body: mujoco.MjsBody, name: str, pos: list[float], half: list[float], mass: float = 0.0) -> None:
    """A board that no camera draws, and the two rails and the bars between them that it stands for."""
    box, thin = mujoco.mjtGeom.mjGEOM_BOX, int(np.argmin(half))
    body.add_geom(name=name, type=box, pos=pos, size=half, group=UNSEEN, mass=mass, **FIXTURE, **HARD)
    long = 0 if thin == 2 else 2  # the way its bars run
    across = 3 - thin - long
    look = {"rgba": STEEL, "mass": 0, **NOTHING}
    for kind, along, places in (
        ("rail", across, [HALF_BAR_M - half[long], half[long] - HALF_BAR_M]),
        ("bar", long, np.arange(BAR_EVERY_M - half[across], half[across], BAR_EVERY_M)),
    ):
        size, other = np.full(3, HALF_BAR_M), long if along == across else across
        size[along] = half[along]
        for i, place in enumerate(places):
            at = np.array(pos, float)
            at[other] += place
            body.add_geom(name=f"{name}_{kind}_{i}", type=box, pos=at, size=size, **look)
