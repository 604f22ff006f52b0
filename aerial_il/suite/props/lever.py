"""A sprung lever on a post: a stirrup on a level hinge, whose crossbar is pulled over."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import FIXTURE, NOTHING
from aerial_il.suite.props.contact import STICTION
from aerial_il.suite.props.post import GREEN, GREY, add_post

LEVER_M = 0.22  # from the hinge to the crossbar
LEAN_RAD = -0.35  # of the lever from the vertical, at zero of its joint
LEVER_STOP_RAD = 1.4
LEVER_FRICTION_NM, LEVER_SPRING_NM_RAD, LEVER_DAMPING = 0.2, 0.4, 0.05  # N m, N m/rad, N m s/rad
BAR_HALF_M, BAR_RADIUS_M = 0.065, 0.008
STEEL, ORANGE = [0.62, 0.65, 0.68, 1.0], [0.95, 0.45, 0.12, 1.0]


def add_lever(spec: mujoco.MjSpec, pulled_rad: float) -> None:
    """A mocap body ``lever_mount``, origin on the hinge, with joint ``lever`` (rad): pulled towards the mount's +x.

    The site ``bar`` is the middle of the crossbar, ``lever`` the hinge, with the mount's axes. A green pin shows where
    the lever is at ``pulled_rad``.
    """
    mount = add_post(spec, "lever_mount", 0.025)
    mount.add_site(name="lever", size=[0.003] * 3, group=4)
    capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
    lean, side = LEAN_RAD + pulled_rad, BAR_HALF_M + 0.03
    pin = [0, side, 0, LEVER_M * np.sin(lean), side, LEVER_M * np.cos(lean)]
    mount.add_geom(name="lever_mark", type=capsule, fromto=pin, size=[0.004, 0, 0], rgba=GREEN, **NOTHING)
    axle = {"fromto": [0, -side, 0, 0, side, 0], "size": [0.012, 0, 0], "rgba": GREY}
    mount.add_geom(name="lever_axle", type=capsule, **axle, **FIXTURE)
    lever = mount.add_body(name="lever", quat=[np.cos(0.5 * LEAN_RAD), 0, np.sin(0.5 * LEAN_RAD), 0])
    lever.add_joint(
        name="lever", axis=[0, 1, 0], range=[0.0, LEVER_STOP_RAD], limited=True, stiffness=LEVER_SPRING_NM_RAD,
        frictionloss=LEVER_FRICTION_NM, solimp_friction=STICTION, damping=LEVER_DAMPING, armature=0.002,
    )  # fmt: skip
    _add_stirrup(lever)


def _add_stirrup(lever: mujoco.MjsBody) -> None:
    """Two legs and the crossbar between them."""
    capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
    for i, y in enumerate((-BAR_HALF_M, BAR_HALF_M)):
        leg = {"fromto": [0, y, 0, 0, y, LEVER_M], "size": [0.006, 0, 0], "rgba": STEEL, "mass": 0.025}
        lever.add_geom(name=f"lever_leg_{i}", type=capsule, **leg, **FIXTURE)
    bar = {"fromto": [0, -BAR_HALF_M, LEVER_M, 0, BAR_HALF_M, LEVER_M], "size": [BAR_RADIUS_M, 0, 0], "rgba": ORANGE}
    lever.add_geom(name="lever_bar", type=capsule, mass=0.04, **bar, **FIXTURE)
    lever.add_site(name="bar", pos=[0, 0, LEVER_M], size=[0.003] * 3, group=4)
