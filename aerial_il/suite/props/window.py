"""A window to be wiped: a sprung, transparent pane in a frame, with patches of dirt that vanish one by one."""

from __future__ import annotations

import mujoco

from aerial_il.robots.parts.collision import FIXTURE, NOTHING
from aerial_il.suite.props.dirt import PATCHES, PITCH_M
from aerial_il.suite.props.post import add_post

PANE_HALF_M = (0.095, 0.235, 0.004)  # up the pane, across it, half its thickness
FRAME_M = 0.008  # half the width of a bar of the frame
STIFFNESS, PRELOAD_N, DAMPING = 150.0, 1.0, 2.0  # of the pane's mount: N/m, N at rest, N s/m
TRAVEL_M = 0.06
MASS_KG = 0.12
# Soaped glass behind a soft sponge, as thick as what a finger sinks into it. It takes no force along the pane: cones of
# friction of both fingers, all of which slide, would double what a step takes.
FACE_CONTACT = {"solref": [0.016, 1.0], "solimp": [0.78, 0.95, 0.006, 0.5, 2.0], "condim": 1, "priority": 1}
GLASS, FRAME, DIRT = [0.55, 0.75, 0.90, 0.35], [0.86, 0.84, 0.80, 1.0], [0.45, 0.30, 0.15, 1.0]


def add_window(spec: mujoco.MjSpec) -> None:
    """Add mocap bodies ``window_stand``, ``window`` and, one after another, ``dirt_0`` ….

    The window's z axis points out of the pane at rest, its x axis up it; its origin is the middle of that face. The
    joint ``pane`` counts how far the pane has been pushed in, m; the site ``pane`` is the middle of its face. Dirt can
    be seen from both sides.
    """
    add_post(spec, "window_stand", 0.02)
    window = spec.worldbody.add_body(name="window", mocap=True)
    _add_frame(window)
    half, box = PANE_HALF_M, mujoco.mjtGeom.mjGEOM_BOX
    pane = window.add_body(name="pane", pos=[0, 0, -half[2]])
    pane.add_joint(
        name="pane", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, -1], range=[0, TRAVEL_M], limited=True,
        stiffness=STIFFNESS, springref=-PRELOAD_N / STIFFNESS, damping=DAMPING, solref_limit=[0.01, 1.0],
    )  # fmt: skip
    pane.add_geom(name="pane", type=box, size=half, mass=MASS_KG, rgba=GLASS, **FIXTURE, **FACE_CONTACT)
    pane.add_site(name="pane", pos=[0, 0, half[2]], size=[0.003] * 3, group=4)
    for k in range(PATCHES):
        patch = spec.worldbody.add_body(name=f"dirt_{k}", mocap=True)
        size = [0.45 * PITCH_M, 0.45 * PITCH_M, half[2] + 0.003]
        patch.add_geom(name=f"dirt_{k}", type=box, size=size, rgba=DIRT, **NOTHING)


def _add_frame(window: mujoco.MjsBody) -> None:
    """Four bars round the pane."""
    box, (x, y, z) = mujoco.mjtGeom.mjGEOM_BOX, PANE_HALF_M
    out_x, out_y = x + FRAME_M + 0.002, y + FRAME_M + 0.002
    bars = {
        "top": ([out_x, 0, -z], [FRAME_M, out_y + FRAME_M, z]),
        "bottom": ([-out_x, 0, -z], [FRAME_M, out_y + FRAME_M, z]),
        "left": ([0, out_y, -z], [out_x - FRAME_M, FRAME_M, z]),
        "right": ([0, -out_y, -z], [out_x - FRAME_M, FRAME_M, z]),
    }
    for name, (pos, size) in bars.items():
        window.add_geom(name=f"window_{name}", type=box, pos=pos, size=size, rgba=FRAME, **FIXTURE)
