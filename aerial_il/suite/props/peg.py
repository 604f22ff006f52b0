"""A round-nosed peg, and sockets for it to stand in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import END, FIXTURE, UNDER_ENDS, WORLD
from aerial_il.suite.props.contact import HARD

PEG_RADIUS_M, PEG_LENGTH_M, PEG_MASS_KG = 0.010, 0.120, 0.06  # length from nose to nose
SLIPPERY = {"friction": [0.3, 0.01, 0.001]}
FRICTIONLESS = {"condim": 1, "priority": 1}
STIFF = {"solref": [0.01, 1.0], "solimp": [0.95, 0.99, 0.001, 0.5, 2.0]}  # between the pads
ORANGE = (0.95, 0.45, 0.12, 1.0)
UNSEEN = 3  # group of geoms that no camera draws
CHAMFER_M, WALL_M, FLOOR_M = 0.005, 0.012, 0.004


def add_peg(spec: mujoco.MjSpec, name: str = "peg", rgba: Sequence[float] = ORANGE) -> None:
    """A free peg ``name``, a capsule along its own z axis, too stiff in rolling to run off a table.

    MuJoCo gives a capsule with an end inside a box one contact instead of two; the other end would go on into the
    table. So each nose is a ball too, which touches table and ground like any ball.
    """
    body = spec.worldbody.add_body(name=name)
    body.add_freejoint(name=name)
    look = {"size": [PEG_RADIUS_M, 0.5 * PEG_LENGTH_M - PEG_RADIUS_M, 0], "rgba": rgba}
    capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
    body.add_geom(name=name, type=capsule, mass=PEG_MASS_KG, condim=6, **look, **WORLD, **SLIPPERY, **STIFF)
    for end, height in ((f"{name}_nose", 1.0), (f"{name}_tail", -1.0)):
        ball = {"pos": [0, 0, height * look["size"][1]], "size": [PEG_RADIUS_M, 0, 0], "group": UNSEEN}
        body.add_geom(name=end, type=mujoco.mjtGeom.mjGEOM_SPHERE, mass=0, condim=6, **ball, **END, **SLIPPERY, **STIFF)
    body.add_site(name=name, size=[0.003] * 3, group=4)


def add_cup(
    spec: mujoco.MjSpec, name: str, *, radius: float, depth: float, rgba: Sequence[float], chamfer: bool
) -> None:
    """A square socket: less to compute, where there are many. It has four walls without friction, and holds pegs alone.

    Args:
        spec, name, radius, depth, rgba: see :func:`add_socket`. chamfer: whether its mouth has one.
    """
    body = spec.worldbody.add_body(name=name, mocap=True)
    wide = radius + WALL_M
    floor = {"pos": [0, 0, 0.5 * FLOOR_M], "size": [wide, wide, 0.5 * FLOOR_M], "rgba": rgba}
    box, slick = mujoco.mjtGeom.mjGEOM_BOX, {"rgba": rgba, **HARD, **FRICTIONLESS}
    body.add_geom(name=f"{name}_floor", type=box, **floor, **UNDER_ENDS, **SLIPPERY, **HARD)
    for i, angle in enumerate(np.arange(4) * np.pi / 2):
        _add_wall(body, f"{name}_wall_{i}", angle, np.pi / 4, radius, FLOOR_M + depth, slick)
        if chamfer:
            _add_chamfer(body, f"{name}_chamfer_{i}", angle, np.pi / 4, radius, FLOOR_M + depth, slick)
    body.add_site(name=name, pos=[0, 0, FLOOR_M + depth], size=[0.003] * 3, group=4)


def add_socket(spec: mujoco.MjSpec, name: str, *, radius: float, depth: float, rgba: Sequence[float]) -> None:
    """An upright octagonal socket with a chamfered mouth: a mocap body, origin at its underside.

    Args:
        spec: the scene. name: of body and site; the site lies on the axis where the bore begins, below the chamfer.
        radius: of the largest cylinder that fits into the bore, m. depth: of the bore, m. rgba: colour.
    """
    body = spec.worldbody.add_body(name=name, mocap=True)
    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
    floor = {"pos": [0, 0, 0.5 * FLOOR_M], "size": [radius + WALL_M, 0.5 * FLOOR_M, 0], "rgba": rgba}
    surface = {"rgba": rgba, **SLIPPERY, **HARD}
    body.add_geom(name=f"{name}_floor", type=cylinder, **floor, **FIXTURE, **SLIPPERY, **HARD)
    for i, angle in enumerate(np.arange(8) * np.pi / 4):
        _add_wall(body, f"{name}_wall_{i}", angle, np.pi / 8, radius, FLOOR_M + depth, surface)
        _add_chamfer(body, f"{name}_chamfer_{i}", angle, np.pi / 8, radius, FLOOR_M + depth, surface)
    body.add_site(name=name, pos=[0, 0, FLOOR_M + depth], size=[0.003] * 3, group=4)


def _add_wall(
    body: mujoco.MjsBody, name: str, angle: float, half: float, radius: float, height: float, surface: dict[str, Any]
) -> None:
    """One wall at ``angle`` ± ``half`` rad about the axis."""
    outward = np.array([np.cos(angle), np.sin(angle), 0.0])
    wall = [0.5 * WALL_M, (radius + 0.5 * WALL_M) * np.tan(half), 0.5 * height]
    look = {"pos": (radius + wall[0]) * outward + [0.0, 0.0, wall[2]], "quat": _about_z(angle), "size": wall}
    body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, **look, **FIXTURE, **surface)


def _add_chamfer(
    body: mujoco.MjsBody, name: str, angle: float, half: float, radius: float, height: float, surface: dict[str, Any]
) -> None:
    """On top of that wall, one face that slopes into the bore at 45°."""
    outward, thick = np.array([np.cos(angle), np.sin(angle), 0.0]), 0.002
    face = [thick, (radius + CHAMFER_M) * np.tan(half), CHAMFER_M / np.sqrt(2.0)]
    into = thick / np.sqrt(2.0)  # from the sloping surface to the middle of the box behind it
    centre = (radius + 0.5 * CHAMFER_M + into) * outward + [0.0, 0.0, height + 0.5 * CHAMFER_M - into]
    quat, slope = np.empty(4), np.array([np.cos(np.pi / 8), 0.0, np.sin(np.pi / 8), 0.0])
    mujoco.mju_mulQuat(quat, _about_z(angle), slope)
    shade = [*(0.8 * np.array(surface["rgba"][:3])), surface["rgba"][3]]
    look = {"pos": centre, "quat": quat, "size": face, **surface, "rgba": shade}
    body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, **look, **FIXTURE)


def _about_z(angle: float) -> np.ndarray:
    return np.array([np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)])
