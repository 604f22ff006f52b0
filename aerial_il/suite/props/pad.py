"""A pad painted on the ground, to land on."""

from __future__ import annotations

import mujoco

from aerial_il.robots.parts.collision import NOTHING

BLUE, WHITE = [0.16, 0.36, 0.66, 1.0], [0.95, 0.96, 0.97, 1.0]
HALF_WIDTH_M, HALF_PAINT_M = 0.30, 0.0005


def add_pad(spec: mujoco.MjSpec, *, tolerance: float) -> None:
    """Add a mocap body ``pad`` with a site of that name, flat on the ground; it touches nothing.

    Args:
        spec: the scene. tolerance: radius of the white disc in its middle, m.
    """
    pad, cylinder = spec.worldbody.add_body(name="pad", mocap=True), mujoco.mjtGeom.mjGEOM_CYLINDER
    pad.add_site(name="pad", size=[0.004] * 3, group=4)
    for name, radius, height, colour in (
        ("pad", HALF_WIDTH_M, HALF_PAINT_M, BLUE),
        ("pad_centre", tolerance, 2.0 * HALF_PAINT_M, WHITE),
    ):
        pad.add_geom(name=name, type=cylinder, size=[radius, height, 0], rgba=colour, **NOTHING)
