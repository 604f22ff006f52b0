"""A low cabinet on a post with one door: vertical hinge, bow handle near the upper edge."""

from __future__ import annotations

import mujoco

from aerial_il.robots.parts.collision import FIXTURE
from aerial_il.suite.props.contact import STICTION
from aerial_il.suite.props.post import add_post

WIDTH_M, HEIGHT_M, DEPTH_M, BOARD_M = 0.36, 0.24, 0.16, 0.006  # of the cabinet; half a board's thickness
LEAF_M = WIDTH_M - 0.01
DOOR_STOP_RAD = 1.75
DOOR_FRICTION_NM, DOOR_DAMPING = 0.3, 0.2  # N m, N m s/rad
LOOP_M = 0.085  # how far the handle stands off the door
BAR_HALF_M, BAR_RADIUS_M = 0.065, 0.007
HINGE_TO_LOOP_M = LEAF_M - BAR_HALF_M - 0.03
HANDLE_HEIGHT_M = HEIGHT_M - 0.02
BODY, LEAF, STEEL = [0.86, 0.84, 0.80, 1.0], [0.32, 0.50, 0.62, 1.0], [0.62, 0.65, 0.68, 1.0]


def add_door(spec: mujoco.MjSpec) -> None:
    """A mocap body ``cabinet``, origin under the middle of its front, with joint ``door`` (rad): opens towards +x.

    Site ``door`` is on the hinge at the handle's height, with the cabinet's axes. Site ``loop`` turns with the door:
    the middle of the opening between door and handle, where a finger goes in; its x points out of the door.
    """
    cabinet = add_post(spec, "cabinet", 0.03)
    hinge = [0, 0.5 * LEAF_M, HANDLE_HEIGHT_M]
    cabinet.add_site(name="door", pos=hinge, size=[0.003] * 3, group=4)
    _add_boards(cabinet)
    leaf = hang_leaf(cabinet)
    box, half = mujoco.mjtGeom.mjGEOM_BOX, [BOARD_M, 0.5 * LEAF_M, 0.5 * HEIGHT_M]
    middle = [BOARD_M, -half[1], half[2]]
    leaf.add_geom(name="door_leaf", type=box, pos=middle, size=half, rgba=LEAF, mass=0.8, **FIXTURE)
    add_handle(leaf, HANDLE_HEIGHT_M)


def hang_leaf(cabinet: mujoco.MjsBody) -> mujoco.MjsBody:
    """Hang the body ``door`` on the left of a cabinet's front, by its hinge ``door``, and return it."""
    leaf = cabinet.add_body(name="door", pos=[0, 0.5 * LEAF_M, 0])
    leaf.add_joint(
        name="door", axis=[0, 0, 1], range=[0.0, DOOR_STOP_RAD], limited=True, frictionloss=DOOR_FRICTION_NM,
        solimp_friction=STICTION, damping=DOOR_DAMPING, armature=0.002,
    )  # fmt: skip
    return leaf


def _add_boards(cabinet: mujoco.MjsBody) -> None:
    """Bottom, top, back and sides, behind the plane of the door."""
    x, y, z = 0.5 * DEPTH_M, 0.5 * WIDTH_M, 0.5 * HEIGHT_M
    boards = {
        "bottom": ([-x, 0, BOARD_M], [x, y, BOARD_M]),
        "top": ([-x, 0, HEIGHT_M - BOARD_M], [x, y, BOARD_M]),
        "back": ([-DEPTH_M + BOARD_M, 0, z], [BOARD_M, y, z]),
        "left": ([-x, y - BOARD_M, z], [x, BOARD_M, z]),
        "right": ([-x, -y + BOARD_M, z], [x, BOARD_M, z]),
    }
    for name, (pos, size) in boards.items():
        look = {"type": mujoco.mjtGeom.mjGEOM_BOX, "pos": pos, "size": size, "rgba": BODY}
        cabinet.add_geom(name=f"cabinet_{name}", **look, **FIXTURE)


def add_handle(leaf: mujoco.MjsBody, height: float) -> None:
    """A level bow at ``height`` m, two stand-offs and the bar between them, with the site ``loop`` in its middle."""
    face, out = 2.0 * BOARD_M, 2.0 * BOARD_M + LOOP_M
    left, right, z = -HINGE_TO_LOOP_M + BAR_HALF_M, -HINGE_TO_LOOP_M - BAR_HALF_M, height
    rods = {
        "handle_left": [face, left, z, out, left, z],
        "handle_right": [face, right, z, out, right, z],
        "handle_bar": [out, left, z, out, right, z],
    }
    look = {"type": mujoco.mjtGeom.mjGEOM_CAPSULE, "size": [BAR_RADIUS_M, 0, 0], "rgba": STEEL, "mass": 0.02}
    for name, ends in rods.items():
        leaf.add_geom(name=name, fromto=ends, **look, **FIXTURE)
    middle = [face + 0.5 * (LOOP_M - BAR_RADIUS_M), -HINGE_TO_LOOP_M, z]
    leaf.add_site(name="loop", pos=middle, size=[0.003] * 3, group=4)
