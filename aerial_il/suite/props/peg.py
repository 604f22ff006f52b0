"""A round-nosed peg, and sockets for it to stand in."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import END, FIXTURE, WORLD
from aerial_il.suite.props.contact import HARD

PEG_RADIUS_M, PEG_LENGTH_M, PEG_MASS_KG = 0.010, 0.120, 0.06  # length from nose to nose
SLIPPERY = {"friction": [0.3, 0.01, 0.001]}
STIFF = {"solref": [0.01, 1.0], "solimp": [0.95, 0.99, 0.001, 0.5, 2.0]}  # between the pads
UNSEEN = 3  # group of geoms that no camera draws
CHAMFER_M, WALL_M, FLOOR_M = 0.005, 0.012, 0.004


def add_peg(spec: mujoco.MjSpec) -> None:
    """A free peg ``peg``, a capsule along its own z axis, too stiff in rolling to run off a table.

    MuJoCo gives a capsule with an end inside a box one contact instead of two; the other end would go on into the
    table. So each nose is a ball too, which touches table and ground like any ball.
    """
    body = spec.worldbody.add_body(name="peg")
    body.add_freejoint(name="peg")
    look = {"size": [PEG_RADIUS_M, 0.5 * PEG_LENGTH_M - PEG_RADIUS_M, 0], "rgba": [0.95, 0.45, 0.12, 1]}
    capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
    body.add_geom(name="peg", type=capsule, mass=PEG_MASS_KG, condim=6, **look, **WORLD, **SLIPPERY, **STIFF)
    for name, height in (("peg_nose", 1.0), ("peg_tail", -1.0)):
        ball = {"pos": [0, 0, height * look["size"][1]], "size": [PEG_RADIUS_M, 0, 0], "group": UNSEEN}
        body.add_geom(
            name=name, type=mujoco.mjtGeom.mjGEOM_SPHERE, mass=0, condim=6, **ball, **END, **SLIPPERY, **STIFF
        )
    body.add_site(name="peg", size=[0.003] * 3, group=4)


def add_socket(spec: mujoco.MjSpec, name: str, *, radius: float, depth: float, rgba: list[float]) -> None:
    """An upright octagonal socket with a chamfered mouth: a mocap body, origin at its underside.

    Args:
        spec: the scene. name: of body and site; the site lies on the axis where the bore begins, below the chamfer.
        radius: of the largest cylinder that fits into the bore, m. depth: of the bore, m. rgba: colour.
    """
    body = spec.worldbody.add_body(name=name, mocap=True)
    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
    floor = {"pos": [0, 0, 0.5 * FLOOR_M], "size": [radius + WALL_M, 0.5 * FLOOR_M, 0], "rgba": rgba}
    body.add_geom(name=f"{name}_floor", type=cylinder, **floor, **FIXTURE, **SLIPPERY, **HARD)
    for i, angle in enumerate(np.arange(8) * np.pi / 4):
        _add_side(body, f"{name}_{{}}_{i}", angle, radius, FLOOR_M + depth, rgba)
    body.add_site(name=name, pos=[0, 0, FLOOR_M + depth], size=[0.003] * 3, group=4)


def _add_side(body: mujoco.MjsBody, name: str, angle: float, radius: float, height: float, rgba: list[float]) -> None:
    """One wall at ``angle`` rad about the axis and, on top of it, one face that slopes into the bore at 45°."""
    box, outward = mujoco.mjtGeom.mjGEOM_BOX, np.array([np.cos(angle), np.sin(angle), 0.0])
    turn = np.array([np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)])
    wall = [0.5 * WALL_M, (radius + 0.5 * WALL_M) * np.tan(np.pi / 8), 0.5 * height]
    centre = (radius + wall[0]) * outward + [0.0, 0.0, wall[2]]
    body.add_geom(
        name=name.format("wall"), type=box, pos=centre, quat=turn, size=wall, rgba=rgba, **FIXTURE, **SLIPPERY, **HARD
    )
    thick = 0.002
    face = [thick, (radius + CHAMFER_M) * np.tan(np.pi / 8), CHAMFER_M / np.sqrt(2.0)]
    into = thick / np.sqrt(2.0)  # from the sloping surface to the middle of the box behind it
    centre = (radius + 0.5 * CHAMFER_M + into) * outward + [0.0, 0.0, height + 0.5 * CHAMFER_M - into]
    quat, slope = np.empty(4), np.array([np.cos(np.pi / 8), 0.0, np.sin(np.pi / 8), 0.0])
    mujoco.mju_mulQuat(quat, turn, slope)
    shade = [*(0.8 * np.array(rgba[:3])), rgba[3]]
    look = {"pos": centre, "quat": quat, "size": face, "rgba": shade}
    body.add_geom(name=name.format("chamfer"), type=box, **look, **FIXTURE, **SLIPPERY, **HARD)
