"""A load on a cable, and a gate of two posts and a low beam to carry it through."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import FIXTURE, NOTHING, WORLD
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.contact_sensors import add_contact_sensor, add_force_sensor
from aerial_il.suite.props.contact import GRASPABLE

LOAD_HALF_M, LOAD_KG, CABLE_M = 0.05, 0.30, 1.0
HALF_WIDTH_M, POST_M, BEAM_HEIGHT_M, ROD_M = 0.30, 0.90, 0.35, 0.015  # of the gate; the last: radius of posts and beam
TAUT = {"solref_limit": [0.02, 1.0], "solimp_limit": [0.95, 0.99, 0.001, 0.5, 2.0]}  # it gives by less than 1 mm
ORANGE, RED, GREEN, BLACK = [0.95, 0.45, 0.12, 1], [0.75, 0.16, 0.14, 1], [0.10, 0.65, 0.30, 1], [0.1, 0.1, 0.1, 1]


def add_slung_load(spec: mujoco.MjSpec, robot: Robot) -> None:
    """A free box ``load`` of 10 cm and 300 g, whose eye hangs by a light cable of 1 m from the robot's fingertips.

    The cable is slack when its ends are nearer to each other, and touches nothing. The site ``load`` is the box's
    middle; the sensor ``load_on_ground`` counts contacts with the ground.
    """
    load = spec.worldbody.add_body(name="load")
    load.add_freejoint(name="load")
    look = {"size": [LOAD_HALF_M] * 3, "rgba": ORANGE}
    load.add_geom(name="load", type=mujoco.mjtGeom.mjGEOM_BOX, mass=LOAD_KG, **look, **WORLD, **GRASPABLE)
    load.add_site(name="load", size=[0.003] * 3, group=4)
    load.add_site(name="eye", pos=[0, 0, LOAD_HALF_M], size=[0.003] * 3, group=4)
    tool = spec.site("tool")
    hook = tool.pos + np.array([robot.gripper.tip_distance, 0.0, 0.0])
    tool.parent.add_site(name="hook", pos=hook, size=[0.003] * 3, group=4)
    cable = spec.add_tendon(name="cable", width=0.006, rgba=BLACK, limited=True, range=[0.0, CABLE_M], **TAUT)
    cable.wrap_site("hook")
    cable.wrap_site("eye")
    add_contact_sensor(spec, "load_on_ground", geoms=("load", "ground"))


def add_gate(spec: mujoco.MjSpec) -> None:
    """A mocap body ``gate``: two posts on the ground and a beam between them; x leads through it.

    The site ``gate`` is on the ground in its middle; the sensor ``gate_force`` feels whatever touches it.
    """
    gate = spec.worldbody.add_body(name="gate", mocap=True)
    left, right = [0, HALF_WIDTH_M], [0, -HALF_WIDTH_M]
    rods = {
        "gate_left": [*left, 0, *left, POST_M],
        "gate_right": [*right, 0, *right, POST_M],
        "gate_beam": [*left, BEAM_HEIGHT_M, *right, BEAM_HEIGHT_M],
    }
    for name, ends in rods.items():
        look = {"fromto": ends, "size": [ROD_M, 0, 0], "rgba": RED}
        gate.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_CAPSULE, **look, **FIXTURE)
    gate.add_site(name="gate", size=[0.003] * 3, group=4)
    add_force_sensor(spec, "gate_force", "gate")


def add_goal(spec: mujoco.MjSpec, radius: float) -> None:
    """A mocap body ``goal`` with a site of that name: a disc painted on the ground, of ``radius`` m."""
    goal, cylinder = spec.worldbody.add_body(name="goal", mocap=True), mujoco.mjtGeom.mjGEOM_CYLINDER
    goal.add_geom(name="goal", type=cylinder, size=[radius, 0.001, 0], rgba=GREEN, **NOTHING)
    goal.add_site(name="goal", size=[0.003] * 3, group=4)
