"""Something to aim at that touches nothing: a ball, with an arrow where a direction matters, or a T where all does."""

from __future__ import annotations

import mujoco

from aerial_il.robots.parts.collision import NOTHING

GREEN = (0.1, 0.65, 0.3)


def add_marker(spec: mujoco.MjSpec, *, tolerance: float, arrow: float = 0.0, bar: float = 0.0) -> None:
    """Add a mocap body ``target`` with a site of that name.

    Args:
        spec: the scene. tolerance: radius of the translucent ball, m. arrow: length of one along +x that ends there, m.
        bar: length of one across its tail, along y, m: it shows how the arrow is turned about itself.
    """
    target = spec.worldbody.add_body(name="target", mocap=True)
    target.add_site(name="target", size=[0.004] * 3, group=4)
    capsule, sphere = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_SPHERE
    target.add_geom(name="target", type=sphere, size=[0.012, 0, 0], rgba=[*GREEN, 1.0], **NOTHING)
    target.add_geom(name="target_tolerance", type=sphere, size=[tolerance, 0, 0], rgba=[*GREEN, 0.4], **NOTHING)
    if arrow:
        shaft = {"fromto": [-arrow, 0, 0, -0.8 * tolerance, 0, 0], "size": [0.006, 0, 0], "rgba": [*GREEN, 0.9]}
        target.add_geom(name="target_direction", type=capsule, **shaft, **NOTHING)
        if bar:
            across = shaft | {"fromto": [-arrow, -0.5 * bar, 0, -arrow, 0.5 * bar, 0]}
            target.add_geom(name="target_across", type=capsule, **across, **NOTHING)
