"""A place on a table, marked with paint."""

from __future__ import annotations

import mujoco

from aerial_il.robots.parts.collision import NOTHING

HALF_PAINT_M, RING_M = 0.0005, 0.02
BLUE, WHITE = [0.16, 0.36, 0.66, 1.0], [0.95, 0.96, 0.97, 1.0]


def add_spot(spec: mujoco.MjSpec, *, radius: float) -> None:
    """Add a mocap body ``spot`` with a site of that name: a disc of ``radius`` m with a rim; it touches nothing."""
    spot, cylinder = spec.worldbody.add_body(name="spot", mocap=True), mujoco.mjtGeom.mjGEOM_CYLINDER
    spot.add_site(name="spot", size=[0.003] * 3, group=4)
    for name, wide, high, rgba in (
        ("spot_rim", radius + RING_M, HALF_PAINT_M, BLUE),
        ("spot", radius, 2.0 * HALF_PAINT_M, WHITE),
    ):
        spot.add_geom(name=name, type=cylinder, size=[wide, high, 0], rgba=rgba, **NOTHING)
