"""A slider: a carriage with an upright handle on a level rail with dry friction."""

from __future__ import annotations

import mujoco

from aerial_il.robots.parts.collision import FIXTURE, NOTHING
from aerial_il.suite.props.contact import GRASPABLE, STICTION
from aerial_il.suite.props.post import GREEN, GREY, add_post

RAIL_M = 0.25  # from stop to stop
FRICTION_N, DAMPING = 1.5, 4.0  # N, N s/m
HANDLE_HALF_M = (0.006, 0.035, 0.03)  # a broad plate across the rail
HANDLE_CENTRE_M = 0.052  # above the middle of the rail
CARRIAGE_HALF_M = (0.025, 0.02, 0.006)
BEAM_HALF_M = (0.5 * RAIL_M + 0.04, 0.018, 0.01)
STEEL, ORANGE = [0.62, 0.65, 0.68, 1.0], [0.95, 0.45, 0.12, 1.0]


def add_slider(spec: mujoco.MjSpec) -> None:
    """Add a mocap body ``rail`` on a post, x along the rail, origin in its middle.

    The joint ``slider`` counts how far the carriage has come from one end, m. The site ``slider`` is the middle of the
    handle, ``rail_end`` where that is at the other end.
    """
    rail = add_post(spec, "rail", 0.02)
    box = mujoco.mjtGeom.mjGEOM_BOX
    rail.add_geom(name="rail", type=box, size=BEAM_HALF_M, rgba=STEEL, **FIXTURE)
    mark = {"size": [0.02, 1.3 * BEAM_HALF_M[1], 0.5 * BEAM_HALF_M[2]], "rgba": GREEN}
    rail.add_geom(name="rail_mark", type=box, pos=[0.5 * RAIL_M, 0, 0.6 * BEAM_HALF_M[2]], **mark, **NOTHING)
    rail.add_site(name="rail_end", pos=[0.5 * RAIL_M, 0, HANDLE_CENTRE_M], size=[0.003] * 3, group=4)
    carriage = rail.add_body(name="slider", pos=[-0.5 * RAIL_M, 0, 0])
    carriage.add_joint(
        name="slider", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0], range=[0, RAIL_M], limited=True,
        frictionloss=FRICTION_N, damping=DAMPING, solref_limit=[0.01, 1.0], solimp_friction=STICTION,
    )  # fmt: skip
    low = BEAM_HALF_M[2] + CARRIAGE_HALF_M[2]
    block = {"pos": [0, 0, low], "size": CARRIAGE_HALF_M, "mass": 0.12, "rgba": GREY}
    carriage.add_geom(name="slider_carriage", type=box, **block, **FIXTURE)
    plate = {"pos": [0, 0, HANDLE_CENTRE_M], "size": HANDLE_HALF_M, "mass": 0.05, "rgba": ORANGE}
    carriage.add_geom(name="slider_handle", type=box, **plate, **FIXTURE, **GRASPABLE)
    carriage.add_site(name="slider", pos=[0, 0, HANDLE_CENTRE_M], size=[0.003] * 3, group=4)
