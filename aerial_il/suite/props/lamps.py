"""A flat panel with three lamps, which show an order for a while and then go out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco

from aerial_il.robots.parts.collision import FIXTURE, NOTHING
from aerial_il.suite.props.contact import HARD

PANEL_HALF_M = (0.035, 0.125, 0.010)
LAMP_RADIUS_M, LAMP_HALF_M, LAMPS_APART_M = 0.024, 0.002, 0.075
LIT_M, DARK_M = PANEL_HALF_M[2], 0.0  # of a lamp's middle above the panel's: half out of its face, or within
CHARCOAL = [0.16, 0.16, 0.18, 1.0]


def add_lamps(spec: mujoco.MjSpec, pos: Sequence[float], colours: Mapping[str, Sequence[float]]) -> None:
    """A panel ``panel``, its middle at ``pos`` (3,) m, and mocap bodies ``lamp_NAME``, discs that lie in it.

    Lamps touch nothing: one is lit where it lies ``LIT_M`` above the panel's middle, and out of sight at ``DARK_M``.
    """
    panel = spec.worldbody.add_body(name="panel", pos=pos)
    box, cylinder = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
    panel.add_geom(name="panel", type=box, size=PANEL_HALF_M, rgba=CHARCOAL, **FIXTURE, **HARD)
    for name, rgba in colours.items():
        lamp = spec.worldbody.add_body(name=f"lamp_{name}", mocap=True)
        look = {"size": [LAMP_RADIUS_M, LAMP_HALF_M, 0], "rgba": rgba}
        lamp.add_geom(name=f"lamp_{name}", type=cylinder, **look, **NOTHING)
