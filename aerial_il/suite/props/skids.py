"""Landing gear: two skids under a base that is to stand on the ground, for the tasks in which it does."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import NOTHING, ROBOT
from aerial_il.suite.physics.contact_sensors import add_contact_sensor

DROP_M, RADIUS_M = 0.12, 0.008  # of a skid's axis below the base's origin; of its tube
STAND_M = DROP_M + RADIUS_M  # height of the base's origin over the ground that it stands on
HALF_LENGTH_M, HALF_TRACK_M, STRUT_M = 0.13, 0.11, 0.06  # the last: struts from the middle of a skid
GREY = [0.30, 0.31, 0.33, 1.0]


def add_skids(spec: mujoco.MjSpec) -> None:
    """Add skids ``skids`` to the robot's base, without mass, and a sensor ``skids_contact`` of what they touch.

    They are a body of their own: to stand on them is not what the base's own contact sensor calls a crash.
    """
    skids = spec.body("base").add_body(name="skids")
    for side, y in (("left", HALF_TRACK_M), ("right", -HALF_TRACK_M)):
        ends = [-HALF_LENGTH_M, y, -DROP_M, HALF_LENGTH_M, y, -DROP_M]
        _add_tube(skids, f"skid_{side}", ends, RADIUS_M, touches=True)
        for where, x in (("front", STRUT_M), ("rear", -STRUT_M)):
            ends = [0.8 * x, 0.3 * y, -0.03, x, y, -DROP_M]
            _add_tube(skids, f"strut_{side}_{where}", ends, 0.6 * RADIUS_M, touches=False)
    add_contact_sensor(spec, "skids_contact", body="skids")


def _add_tube(body: mujoco.MjsBody, name: str, ends: list[float], radius: float, *, touches: bool) -> None:
    look = {"fromto": ends, "size": [radius, 0, 0], "rgba": GREY, "mass": 0}
    body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_CAPSULE, **look, **(ROBOT if touches else NOTHING))


def standing(pos: np.ndarray) -> np.ndarray:
    """Position (3,) of a base that stands with its middle over ``pos`` (2,), m."""
    return np.array([pos[0], pos[1], STAND_M])
