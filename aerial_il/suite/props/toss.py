"""A ball on a tee, and a bin behind a fence that is painted on the ground."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import FIXTURE, NOTHING, WORLD
from aerial_il.suite.physics.contact_sensors import add_contact_sensor, add_touch_sensor
from aerial_il.suite.props.bowl import HALF_WALL_M, add_bowl
from aerial_il.suite.props.post import GREY, add_post

BALL_RADIUS_M, BALL_KG = 0.03, 0.05
BIN_RADIUS_M, BIN_WALL_M = 0.16, 0.24  # to the middle of a wall; its height
HALF_FLOOR_M = 0.03  # in one step a ball that comes from 2.2 m above gets 2.6 cm into it, less than its radius
TEE_HALF_M, RIM_HALF_M = 0.012, 0.003  # of the recess in which the ball lies; half width and height of its rim
TEE_TOP_M = 2.0 * RIM_HALF_M + (BALL_RADIUS_M**2 - TEE_HALF_M**2) ** 0.5  # of the middle of a ball on the rim
# Filled with sand: it does not bounce, and rolling friction stops it.
BALL = {"friction": [1.2, 0.02, 0.003], "solref": [0.01, 1.0], "solimp": [0.95, 0.99, 0.001, 0.5, 2.0], "condim": 6}
ORANGE, RED = [0.95, 0.45, 0.12, 1], [0.85, 0.25, 0.20, 0.5]


def add_ball_on_tee(spec: mujoco.MjSpec) -> None:
    """A free ball ``ball`` of 6 cm and 50 g, and a mocap body ``tee``, origin on its top, in whose recess it lies.

    Sensors count contacts of the pads with the ball, of any part of the robot with it, and of it with the ground.
    """
    ball = spec.worldbody.add_body(name="ball")
    ball.add_freejoint(name="ball")
    look = {"size": [BALL_RADIUS_M, 0, 0], "rgba": ORANGE}
    ball.add_geom(name="ball", type=mujoco.mjtGeom.mjGEOM_SPHERE, mass=BALL_KG, **look, **WORLD, **BALL)
    ball.add_site(name="ball", size=[0.003] * 3, group=4)
    tee = add_post(spec, "tee", 0.02)
    tee.add_site(name="tee", size=[0.003] * 3, group=4)
    for i in range(4):
        angle, away = 0.5 * np.pi * i, TEE_HALF_M + RIM_HALF_M
        pos = [away * np.cos(angle), away * np.sin(angle), RIM_HALF_M]
        turned = {"pos": pos, "quat": [np.cos(0.5 * angle), 0, 0, np.sin(0.5 * angle)]}
        size = [RIM_HALF_M, TEE_HALF_M + 2.0 * RIM_HALF_M, RIM_HALF_M]
        tee.add_geom(name=f"tee_{i}", type=mujoco.mjtGeom.mjGEOM_BOX, size=size, rgba=GREY, **turned, **FIXTURE)
    for side in ("left", "right"):
        add_contact_sensor(spec, f"grip_{side}", geoms=(f"pad_{side}", "ball"))
    add_touch_sensor(spec, "robot_on_ball", "ball")
    add_contact_sensor(spec, "ball_on_ground", geoms=("ball", "ground"))


def add_fenced_bin(spec: mujoco.MjSpec, fence: float) -> None:
    """A mocap body ``bin``, origin at its underside, and a red disc of ``fence`` m radius painted around it.

    The site ``fence`` is a point of the disc's edge, level with the site ``bin`` in the bin's middle.
    """
    body = add_bowl(spec, "bin", radius=BIN_RADIUS_M, wall=BIN_WALL_M, half_floor=HALF_FLOOR_M)
    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
    body.add_geom(name="fence", type=cylinder, size=[fence, 0.5 * HALF_WALL_M, 0], rgba=RED, **NOTHING)
    body.add_site(name="fence", pos=[fence, 0, 0], size=[0.003] * 3, group=4)
