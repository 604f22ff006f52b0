"""A beam that lies on two supports, and a frame with two U-shaped hooks that it is to be laid into."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import FIXTURE, NOTHING, WORLD
from aerial_il.suite.props.contact import GRASPABLE, HARD

BEAM_HALF_M = (0.17, 0.010, 0.010)  # along it, and across
BEAM_MASS_KG = 0.12
SUPPORT_M = 0.10  # of the middle of each support from the beam's
HOOK_M = 0.13  # of the middle of each hook from the frame's
CLEARANCE_M = 0.003  # hook less beam, in width
FLOOR_M = 0.06  # of hooks and supports over the table: fingers reach below the beam
WALL_M, WALL_HALF_M, HOOK_HALF_M = 0.022, 0.003, 0.010  # of a hook: height, half a thickness, half a length
CHAMFER_M = 0.002
SLIPPERY = {"friction": [0.3, 0.005, 0.0001], "priority": 1}
ORANGE, GREY, BLUE = [0.95, 0.45, 0.12, 1.0], [0.62, 0.62, 0.64, 1.0], [0.22, 0.42, 0.72, 1.0]
DARK = [0.16, 0.32, 0.56, 1.0]
BOX = mujoco.mjtGeom.mjGEOM_BOX


def add_beam(spec: mujoco.MjSpec) -> None:
    """A free square beam ``beam`` along its own x axis, a stripe along its upper face."""
    body = spec.worldbody.add_body(name="beam")
    body.add_freejoint(name="beam")
    look = {"size": BEAM_HALF_M, "rgba": ORANGE}
    body.add_geom(name="beam", type=BOX, mass=BEAM_MASS_KG, **look, **WORLD, **GRASPABLE)
    stripe = {"pos": [0, 0, BEAM_HALF_M[2]], "size": [BEAM_HALF_M[0], 0.003, 0.0005], "rgba": DARK}
    body.add_geom(name="beam_stripe", type=BOX, mass=0, **stripe, **NOTHING)
    body.add_site(name="beam", size=[0.003] * 3, group=4)


def add_supports(spec: mujoco.MjSpec) -> None:
    """Two blocks to lay the beam on: a mocap body ``supports``, origin between their feet, x from one to the other."""
    body = spec.worldbody.add_body(name="supports", mocap=True)
    for name, x in (("left", -SUPPORT_M), ("right", SUPPORT_M)):
        look = {"pos": [x, 0, 0.5 * FLOOR_M], "size": [0.012, 0.03, 0.5 * FLOOR_M], "rgba": GREY}
        body.add_geom(name=f"support_{name}", type=BOX, **look, **FIXTURE, **HARD)


def add_frame(spec: mujoco.MjSpec) -> None:
    """Two hooks, open above and at both ends: a mocap body ``frame``, origin between their feet, x along the beam.

    The site ``frame`` is where the middle of a beam is that lies in both.
    """
    body = spec.worldbody.add_body(name="frame", mocap=True)
    for name, x in (("left", -HOOK_M), ("right", HOOK_M)):
        _add_hook(body, f"hook_{name}", x)
    bar = {"pos": [0, 0, 0.005], "size": [HOOK_M, 0.008, 0.005], "rgba": DARK}
    body.add_geom(name="frame_bar", type=BOX, **bar, **FIXTURE, **HARD)
    body.add_site(name="frame", pos=[0, 0, FLOOR_M + BEAM_HALF_M[2]], size=[0.003] * 3, group=4)


def _add_hook(frame: mujoco.MjsBody, name: str, x: float) -> None:
    """A block with two walls on it, whose upper edges slope outwards at 45°."""
    inner = BEAM_HALF_M[1] + 0.5 * CLEARANCE_M
    feel = {**FIXTURE, **HARD, **SLIPPERY}
    block = {"pos": [x, 0, 0.5 * FLOOR_M], "size": [HOOK_HALF_M, inner + 2.0 * WALL_HALF_M, 0.5 * FLOOR_M]}
    frame.add_geom(name=f"{name}_block", type=BOX, rgba=BLUE, **block, **feel)
    for side, sign in (("a", 1.0), ("b", -1.0)):
        centre = [x, sign * (inner + WALL_HALF_M), FLOOR_M + 0.5 * WALL_M]
        wall = {"pos": centre, "size": [HOOK_HALF_M, WALL_HALF_M, 0.5 * WALL_M], "rgba": BLUE}
        frame.add_geom(name=f"{name}_wall_{side}", type=BOX, **wall, **feel)
        thick, lean = 0.002, -0.125 * np.pi * sign
        into = thick / np.sqrt(2.0)  # from the sloping face to the middle of the box behind it
        y = sign * (inner + 0.5 * CHAMFER_M + into)
        face = {
            "pos": [x, y, FLOOR_M + WALL_M + 0.5 * CHAMFER_M - into],
            "quat": [np.cos(lean), np.sin(lean), 0, 0],
            "size": [HOOK_HALF_M, thick, CHAMFER_M / np.sqrt(2.0)],
        }
        frame.add_geom(name=f"{name}_chamfer_{side}", type=BOX, rgba=DARK, **face, **feel)
