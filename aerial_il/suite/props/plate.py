"""A plate to inspect: a disc on a sprung mount that leans on a post."""

from __future__ import annotations

import mujoco

from aerial_il.robots.parts.collision import FIXTURE, NOTHING
from aerial_il.suite.props.post import GREY, add_post

RADIUS_M, HALF_THICKNESS_M = 0.09, 0.005
SPOT_RADIUS_M = 0.04  # the mark in its middle
STIFFNESS, PRELOAD_N, DAMPING = 130.0, 1.0, 1.0  # of the mount: N/m, N at rest, N s/m
TRAVEL_M = 0.06
# A soft skin, as ultrasound phantoms have, wet with couplant gel. A bare plate this light bounces off a hard probe
# within a physics step, and the force that the solver reports jumps between none and twice the true one.
FACE = {"friction": [0.2, 0.005, 0.0001], "solref": [0.02, 1.0], "solimp": [0.5, 0.5, 0.001, 0.5, 2.0]}
FACE_CONTACT = {**FACE, "condim": 4, "priority": 1}
MASS_KG = 0.03
STEEL, DARK = [0.70, 0.74, 0.80, 1.0], [0.13, 0.36, 0.60, 1.0]


def add_plate(spec: mujoco.MjSpec) -> None:
    """Add mocap bodies ``plate_mount``, z axis out of the plate and origin in its face at rest, and ``plate_stand``.

    The joint ``plate`` counts how far the plate has been pushed in, m; the site ``plate`` is the middle of its face.
    """
    add_post(spec, "plate_stand", 0.02)
    mount = spec.worldbody.add_body(name="plate_mount", mocap=True)
    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
    core = {"fromto": [0, 0, -TRAVEL_M - 0.02, 0, 0, -TRAVEL_M - 0.01], "size": [0.05, 0, 0], "rgba": GREY}
    mount.add_geom(name="plate_mount", type=cylinder, **core, **FIXTURE)
    plate = mount.add_body(name="plate", pos=[0, 0, -HALF_THICKNESS_M])
    plate.add_joint(
        name="plate", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, -1], range=[0, TRAVEL_M], limited=True,
        stiffness=STIFFNESS, springref=-PRELOAD_N / STIFFNESS, damping=DAMPING, solref_limit=[0.01, 1.0],
    )  # fmt: skip
    disc = {"size": [RADIUS_M, HALF_THICKNESS_M, 0], "mass": MASS_KG, "rgba": STEEL}
    plate.add_geom(name="plate", type=cylinder, **disc, **FIXTURE, **FACE_CONTACT)
    spot = {"pos": [0, 0, HALF_THICKNESS_M], "size": [SPOT_RADIUS_M, 0.0005, 0], "mass": 0, "rgba": DARK}
    plate.add_geom(name="plate_spot", type=cylinder, **spot, **NOTHING)
    rod = {"fromto": [0, 0, 0, 0, 0, -TRAVEL_M], "size": [0.012, 0, 0], "mass": 0, "rgba": GREY}
    plate.add_geom(name="plate_rod", type=cylinder, **rod, **NOTHING)
    plate.add_site(name="plate", pos=[0, 0, HALF_THICKNESS_M], size=[0.003] * 3, group=4)
