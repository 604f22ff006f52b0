"""A big red button: a sprung mushroom cap in a housing on a post."""

from __future__ import annotations

import mujoco

from aerial_il.robots.parts.collision import FIXTURE
from aerial_il.suite.props.contact import GRASPABLE
from aerial_il.suite.props.post import add_post

TRAVEL_M = 0.020  # from rest to the stop
CAP_RADIUS_M, CAP_HEIGHT_M, CAP_MASS_KG = 0.03, 0.030, 0.02
HOUSING_HALF_M = (0.04, 0.04, 0.02)
PRELOAD_N, FULL_FORCE_N = 0.8, 2.0  # of the spring, at rest and at the stop: light enough for a robot of 0.7 kg
DAMPING = 1.0  # N s/m
YELLOW, RED = [0.93, 0.76, 0.15, 1.0], [0.80, 0.10, 0.10, 1.0]


def add_button(spec: mujoco.MjSpec) -> None:
    """Add mocap bodies ``button``, origin in its face and z axis out of it, and ``button_stand``, the post behind it.

    The joint ``button`` counts how far the cap is pressed, m; the site ``button`` is the middle of the cap's top.
    """
    add_post(spec, "button_stand", 0.02)
    housing = spec.worldbody.add_body(name="button", mocap=True)
    box, cylinder = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
    look = {"pos": [0, 0, -HOUSING_HALF_M[2]], "size": HOUSING_HALF_M, "rgba": YELLOW}
    housing.add_geom(name="button_housing", type=box, **look, **FIXTURE)
    cap = housing.add_body(name="button_cap", pos=[0, 0, 0.5 * CAP_HEIGHT_M])
    stiffness = (FULL_FORCE_N - PRELOAD_N) / TRAVEL_M
    cap.add_joint(
        name="button", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, -1], range=[0, TRAVEL_M], limited=True,
        stiffness=stiffness, springref=-PRELOAD_N / stiffness, damping=DAMPING, solref_limit=[0.01, 1.0],
    )  # fmt: skip
    look = {"size": [CAP_RADIUS_M, 0.5 * CAP_HEIGHT_M, 0], "mass": CAP_MASS_KG, "rgba": RED}
    cap.add_geom(name="button_cap", type=cylinder, **look, **FIXTURE, **GRASPABLE)
    cap.add_site(name="button", pos=[0, 0, 0.5 * CAP_HEIGHT_M], size=[0.003] * 3, group=4)
