"""A post that carries a fixture."""

from __future__ import annotations

import mujoco

from aerial_il.robots.parts.collision import FIXTURE

POST_LENGTH_M = 0.75  # it goes on below the ground, so that a fixture can be mounted at any height up to this
GREY, GREEN = [0.45, 0.42, 0.40, 1.0], [0.10, 0.65, 0.30, 1.0]


def add_post(spec: mujoco.MjSpec, name: str, radius: float) -> mujoco.MjsBody:
    """Add a mocap body ``name`` to mount a fixture on, origin at the top of a round post of ``radius`` m; return it."""
    body = spec.worldbody.add_body(name=name, mocap=True)
    cylinder, half = mujoco.mjtGeom.mjGEOM_CYLINDER, 0.5 * POST_LENGTH_M
    body.add_geom(name=f"{name}_post", type=cylinder, pos=[0, 0, -half], size=[radius, half, 0], rgba=GREY, **FIXTURE)
    return body
