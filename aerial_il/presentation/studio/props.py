"""Props whose parts are flat or straight for the sake of contacts, drawn as round as they are meant."""

import mujoco
import numpy as np

from aerial_il.presentation.studio.solids import turned
from aerial_il.presentation.studio.workshop import Workshop, hide

RIM_POINTS = 8


def dress_props(shop: Workshop) -> None:
    """Make the bowl and the wheel of the valve round, where a scene has them."""
    _dress_bowl(shop)
    _dress_wheel(shop)


def _dress_bowl(shop: Workshop) -> None:
    wall, floor = shop.spec.geom("bowl_wall_0"), shop.spec.geom("bowl_floor_0")
    if wall is None or floor is None:
        return
    thick, height, radius = float(wall.size[0]), 2.0 * float(wall.size[2]), float(wall.pos[0])
    low = 2.0 * float(floor.size[2])
    outer, inner = radius + thick, radius - thick
    profile = [(0.0, 0.0), (0.8 * outer, 0.0), (0.95 * outer, 0.15 * height), (outer, 0.5 * height), (outer, height),
               (inner, height), (inner, 0.55 * height), (0.9 * inner, low + 0.15 * height), (0.75 * inner, low),
               (0.0, low)]  # fmt: skip
    shop.add(wall.parent, turned, *profile, rgba=tuple(wall.rgba), material="gloss")
    for geom in shop.spec.geoms:
        if geom.name.startswith("bowl_"):
            hide(geom)


def _dress_wheel(shop: Workshop) -> None:
    rims = [geom for geom in shop.spec.geoms if geom.name.startswith("valve_rim_")]
    if not rims:
        return
    thick = float(rims[0].size[0])
    radius = max(float(np.hypot(geom.pos[0], geom.pos[1])) for geom in rims) / np.cos(np.pi / len(rims))
    turn = np.linspace(-np.pi, np.pi, RIM_POINTS + 1)
    profile = [(radius + thick * float(np.sin(t)), thick * float(np.cos(t))) for t in turn]
    shop.add(rims[0].parent, turned, *profile[::-1], rgba=tuple(rims[0].rgba), material="gloss")
    for geom in rims:
        assert geom.type == mujoco.mjtGeom.mjGEOM_CAPSULE
        hide(geom)
