"""A bar to stand on: a level square beam on two posts, with a groove along its top."""

from __future__ import annotations

import mujoco

from aerial_il.robots.parts.collision import FIXTURE
from aerial_il.suite.props.contact import GRASPABLE
from aerial_il.suite.props.post import GREY, POST_LENGTH_M

BAR_HALF_M = (0.24, 0.020, 0.018)  # along it, and across
RIM_M, GROOVE_M, INSET_M = 0.005, 0.009, 0.003  # of the groove's rims: width, height, how far inside the beam's sides
SLIPPERY = {"friction": [0.2, 0.005, 0.0001], "priority": 1}  # fingers that close draw the palm over the middle
POST_M, POST_RADIUS_M = 0.22, 0.014  # of the middle of each post from the bar's
WOOD, DARK = [0.72, 0.50, 0.28, 1.0], [0.45, 0.30, 0.16, 1.0]
BOX = mujoco.mjtGeom.mjGEOM_BOX


def add_perch(spec: mujoco.MjSpec) -> None:
    """A mocap body ``perch``, origin in the middle of the bar, x along it; a site of that name is there, too.

    The rims bear the palm of a gripper; its wrist, which is round and protrudes, hangs in the groove.
    """
    body = spec.worldbody.add_body(name="perch", mocap=True)
    length, width, height = BAR_HALF_M
    core = {"pos": [0, 0, -0.5 * GROOVE_M], "size": [length, width, height - 0.5 * GROOVE_M], "rgba": WOOD}
    body.add_geom(name="bar", type=BOX, **core, **FIXTURE, **GRASPABLE)
    for name, sign in (("left", 1.0), ("right", -1.0)):
        place = [0, sign * (width - INSET_M - 0.5 * RIM_M), height - 0.5 * GROOVE_M]
        rim = {"pos": place, "size": [length, 0.5 * RIM_M, 0.5 * GROOVE_M], "rgba": DARK}
        body.add_geom(name=f"rim_{name}", type=BOX, **rim, **FIXTURE, **{**GRASPABLE, **SLIPPERY})
        half = 0.5 * POST_LENGTH_M
        post = {"pos": [-sign * POST_M, 0, -half - height], "size": [POST_RADIUS_M, half, 0], "rgba": GREY}
        body.add_geom(name=f"perch_post_{name}", type=mujoco.mjtGeom.mjGEOM_CYLINDER, **post, **FIXTURE)
    body.add_site(name="perch", size=[0.003] * 3, group=4)
