"""A table that moves by itself: a heavy top on two level slides, which a spring draws to the middle of its track.

All its energy is in the state. The spring's stiffness is the set-point of two actuators, written once per episode: so
each episode has a period of its own, and a state that is restored moves on as it did.
"""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import FIXTURE, NOTHING
from aerial_il.suite.physics.view import View
from aerial_il.suite.props.contact import HARD
from aerial_il.suite.props.place import place
from aerial_il.suite.props.table import TABLE_HALF_THICKNESS_M, TABLE_HEIGHT_M

TOP_HALF_M, TABLE_MASS_KG = 0.16, 500.0  # who leans on it with 20 N for a second changes its speed by 4 cm/s
COLUMN_RADIUS_M, OFF_GROUND_M = 0.03, 0.02
RAIL_HALF_M = (0.30, 0.02, 0.002)
SLIDES = ("table_x", "table_y")
WOOD, GREY, PAINT = [0.78, 0.68, 0.55, 1], [0.45, 0.42, 0.40, 1], [0.60, 0.62, 0.66, 1]


def add_moving_table(spec: mujoco.MjSpec) -> None:
    """A mocap body ``track``, painted on the ground under the middle of the course, and the body ``table`` on it.

    The site ``track`` is that middle, at the height of the table's top. The joints ``table_x`` and ``table_y`` count
    how far the table is from it, m, along the world's axes; they have neither friction nor damping.
    """
    box, cylinder = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
    track = spec.worldbody.add_body(name="track", mocap=True)
    length, width, height = RAIL_HALF_M
    for name, size in (("rail_x", RAIL_HALF_M), ("rail_y", (width, length, height))):
        track.add_geom(name=name, type=box, size=size, rgba=PAINT, **NOTHING)
    track.add_site(name="track", pos=[0, 0, TABLE_HEIGHT_M], size=[0.003] * 3, group=4)
    table = track.add_body(name="table")
    for name, axis in zip(SLIDES, ([1, 0, 0], [0, 1, 0]), strict=True):
        table.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        _add_spring(spec, name)
    under = TABLE_HEIGHT_M - 2.0 * TABLE_HALF_THICKNESS_M
    top = {"pos": [0, 0, under + TABLE_HALF_THICKNESS_M], "size": [TOP_HALF_M, TOP_HALF_M, TABLE_HALF_THICKNESS_M]}
    table.add_geom(name="table", type=box, mass=TABLE_MASS_KG, rgba=WOOD, **top, **FIXTURE, **HARD)
    column = {"fromto": [0, 0, OFF_GROUND_M, 0, 0, under], "size": [COLUMN_RADIUS_M, 0, 0], "mass": 0, "rgba": GREY}
    table.add_geom(name="table_column", type=cylinder, **column, **FIXTURE, **HARD)


def _add_spring(spec: mujoco.MjSpec, joint: str) -> None:
    """An actuator that pulls a joint back to zero with its set-point, N/m, times how far it is from there."""
    spring = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    spring.gaintype = mujoco.mjtGain.mjGAIN_AFFINE
    spring.gainprm[:3] = [0.0, -1.0, 0.0]


def set_in_motion(
    view: View, world: int, middle: np.ndarray, offset: np.ndarray, velocity: np.ndarray, period_s: float
) -> None:
    """Let the table of one world swing about ``middle`` (2,) m: from ``offset`` (2,) m with ``velocity`` (2,) m/s."""
    place(view, world, "track", np.array([*middle, 0.0]))
    stiffness = TABLE_MASS_KG * (2.0 * np.pi / period_s) ** 2
    for k, name in enumerate(SLIDES):
        position, speed = view.joint(name)
        position[world], speed[world] = offset[k], velocity[k]
        view.worlds.bind("ctrl")[world, view.model.actuator(name).id] = stiffness
