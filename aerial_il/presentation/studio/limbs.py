"""An arm's shape: tubes between housings that lie along the joints' axes; and a gripper's."""

from itertools import count

import mujoco
import numpy as np

from aerial_il.presentation.studio.solids import block, disc, tube
from aerial_il.presentation.studio.workshop import Workshop, hide, upright_along

HOUSING, CAP, METAL = (0.22, 0.23, 0.25, 1.0), (0.70, 0.72, 0.75, 1.0), (0.66, 0.68, 0.71, 1.0)


def dress_arm(shop: Workshop) -> None:
    """Give every ``link_i`` that is drawn as a capsule a tube, and its joint a housing."""
    for i in count():
        body, drawn = shop.spec.body(f"link_{i}"), shop.spec.geom(f"link_{i}")
        joint, elbow = shop.spec.joint(f"joint_{i}"), shop.spec.geom(f"elbow_{i}")
        if body is None or joint is None:
            return
        if drawn is None or elbow is None or drawn.type != mujoco.mjtGeom.mjGEOM_CAPSULE:
            continue
        _dress_link(shop, body, drawn)
        _dress_joint(shop, body, np.array(joint.axis, float), elbow, 2.0 * np.array(drawn.pos, float))


def _dress_link(shop: Workshop, body: mujoco.MjsBody, drawn: mujoco.MjsGeom) -> None:
    radius, tip = float(drawn.size[0]), 2.0 * np.array(drawn.pos, float)
    length = float(np.linalg.norm(tip))
    shop.add(body, tube, length, (1.15 * radius, 0.82 * radius, 1.05 * radius), quat=tuple(upright_along(tip)),
             rgba=tuple(drawn.rgba), material="satin")  # fmt: skip
    hide(drawn)


def _dress_joint(
    shop: Workshop, body: mujoco.MjsBody, axis: np.ndarray, elbow: mujoco.MjsGeom, tip: np.ndarray
) -> None:
    radius = float(elbow.size[0])
    hide(elbow)
    quat = tuple(upright_along(axis))
    across = abs(float(axis @ tip)) < 0.5 * float(np.linalg.norm(tip))
    half = radius * (1.15 if across else 0.8)
    shop.add(body, disc, 1.12 * radius, half, 0.22 * radius, quat=quat, rgba=HOUSING, material="satin")
    if across:
        for side in (-1.0, 1.0):
            shop.add(body, disc, 0.78 * radius, 0.08 * radius, 0.05 * radius, pos=tuple(side * 1.05 * half * axis),
                     quat=quat, rgba=CAP, material="metal")  # fmt: skip


def dress_gripper(shop: Workshop) -> None:
    """Give the palm a drive and rails, and round off the fingers; the pads keep their size."""
    body, palm = shop.spec.body("palm"), shop.spec.geom("palm")
    if body is None or palm is None or palm.type != mujoco.mjtGeom.mjGEOM_BOX:
        return
    t, wide, high = (float(size) for size in palm.size)
    hide(palm)
    shop.add(body, block, (t, wide, high), 0.35 * t, rgba=HOUSING, material="satin")
    shop.add(body, block, (0.35 * t, 0.94 * wide, 0.45 * high), 0.1 * t, pos=(0.9 * t, 0, 0), rgba=METAL,
             material="metal")  # fmt: skip
    shop.add(body, block, (1.1 * t, 0.45 * wide, 0.95 * high), 0.4 * t, pos=(-1.5 * t, 0, 0), rgba=HOUSING,
             material="satin")  # fmt: skip
    for side in ("left", "right"):
        finger, drawn = shop.spec.body(f"finger_{side}"), shop.spec.geom(f"finger_{side}")
        if finger is None or drawn is None or drawn.type != mujoco.mjtGeom.mjGEOM_BOX:
            continue
        long, thick, broad = (float(size) for size in drawn.size)
        x, y, z = (float(p) for p in drawn.pos)
        hide(drawn)
        shop.add(finger, block, (long, 1.2 * thick, broad), 0.5 * thick, pos=(x, y, z), rgba=METAL, material="metal")
        shop.add(finger, block, (0.22 * long, 2.4 * thick, 1.1 * broad), 0.6 * thick, pos=(x - 0.78 * long, y, z),
                 rgba=HOUSING, material="satin")  # fmt: skip
