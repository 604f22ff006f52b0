"""A handwheel valve lying on a post: its spindle is vertical, a finger fits between its spokes."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import FIXTURE, NOTHING
from aerial_il.suite.props.contact import STICTION
from aerial_il.suite.props.post import GREEN, GREY, add_post

VALVE_OPEN_RAD = 1.25 * np.pi  # where the yellow spoke is over the green mark; closed is at zero
VALVE_STOP_RAD = VALVE_OPEN_RAD + 0.5
VALVE_FRICTION_NM, VALVE_DAMPING = 0.3, 0.1  # N m, N m s/rad: a greased spindle
WHEEL_RADIUS_M, RIM_RADIUS_M = 0.21, 0.008
GAP_M = 0.14  # from the spindle to where a finger pushes
SPOKES, RIM_SEGMENTS = 4, 12
RED, YELLOW = [0.80, 0.16, 0.13, 1.0], [0.95, 0.80, 0.10, 1.0]


def add_valve(spec: mujoco.MjSpec) -> None:
    """A mocap body ``valve_mount``, origin at the wheel's centre, with hinge ``valve`` (rad, anticlockwise opens).

    Site ``gap`` turns with the wheel: the middle of the opening behind the yellow spoke, where a finger goes in.
    """
    mount = add_post(spec, "valve_mount", 0.03)
    mount.add_site(name="valve", size=[0.003] * 3, group=4)
    _add_mark(mount)
    wheel = mount.add_body(name="valve")
    wheel.add_joint(
        name="valve", axis=[0, 0, 1], range=[0.0, VALVE_STOP_RAD], limited=True, frictionloss=VALVE_FRICTION_NM,
        solimp_friction=STICTION, damping=VALVE_DAMPING, armature=0.005,
    )  # fmt: skip
    _add_wheel(wheel)
    middle = -np.pi / SPOKES
    wheel.add_site(name="gap", pos=[GAP_M * np.cos(middle), GAP_M * np.sin(middle), 0], size=[0.003] * 3, group=4)


def _add_mark(mount: mujoco.MjsBody) -> None:
    """Pointer below the wheel, where the yellow spoke is when the valve is open."""
    c, s = np.cos(VALVE_OPEN_RAD), np.sin(VALVE_OPEN_RAD)
    capsule, reach = mujoco.mjtGeom.mjGEOM_CAPSULE, WHEEL_RADIUS_M + 0.05
    ends = [0.03 * c, 0.03 * s, -0.03, reach * c, reach * s, -0.03]
    mount.add_geom(name="valve_mark", type=capsule, fromto=ends, size=[0.008, 0, 0], rgba=GREEN, **NOTHING)


def _add_wheel(wheel: mujoco.MjsBody) -> None:
    """Rim, spokes and hub; the first spoke is yellow."""
    capsule, cylinder = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER
    rod = {"type": capsule, "size": [RIM_RADIUS_M, 0, 0], "mass": 0.03, **FIXTURE}
    angle = 2.0 * np.pi * np.arange(RIM_SEGMENTS + 1) / RIM_SEGMENTS
    x, y = WHEEL_RADIUS_M * np.cos(angle), WHEEL_RADIUS_M * np.sin(angle)
    for i in range(RIM_SEGMENTS):
        wheel.add_geom(name=f"valve_rim_{i}", fromto=[x[i], y[i], 0, x[i + 1], y[i + 1], 0], rgba=RED, **rod)
    for i in range(SPOKES):
        k, colour = i * RIM_SEGMENTS // SPOKES, RED if i else YELLOW
        wheel.add_geom(name=f"valve_spoke_{i}", fromto=[0, 0, 0, x[k], y[k], 0], rgba=colour, **rod)
    hub = {"size": [0.025, 0.014, 0], "rgba": GREY, "mass": 0.1}
    wheel.add_geom(name="valve_hub", type=cylinder, pos=[0, 0, 0.004], **hub, **FIXTURE)
