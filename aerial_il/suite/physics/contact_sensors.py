"""Contact sensors, by which tasks know who touches whom, and how hard."""

from __future__ import annotations

import mujoco

FOUND, FORCE = 1, 2  # what MuJoCo's contact sensor reports
KEEP_FIRST, NET_FORCE, ONE_SLOT = 0, 3, 1  # how it reduces many contacts to one
SUBTREE = mujoco.mjtObj.mjOBJ_XBODY
CONTACT_ALONE = "the contact force alone: a sensor in the wrist also feels the gripper's weight and inertia"
ROBOT = "base"  # the body that carries all of it
GRIPPER = "palm"  # the body that carries the fingers: a force sensor there is one in the wrist


def add_contact_sensor(spec: mujoco.MjSpec, name: str, *, body: str = "", geoms: tuple[str, str] | None = None) -> None:
    """Add a sensor that counts contacts: of a body's own geoms with anything, or between two geoms."""
    sensor = spec.add_sensor(name=name, type=mujoco.mjtSensor.mjSENS_CONTACT)
    if geoms is None:
        sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_BODY, body
    else:
        sensor.objtype = sensor.reftype = mujoco.mjtObj.mjOBJ_GEOM
        sensor.objname, sensor.refname = geoms
    sensor.intprm[0], sensor.intprm[1], sensor.intprm[2] = FOUND, KEEP_FIRST, ONE_SLOT


def add_touch_sensor(spec: mujoco.MjSpec, name: str, body: str = "") -> None:
    """Add a sensor that counts contacts of any part of the robot with ``body``, or with anything."""
    sensor = spec.add_sensor(name=name, type=mujoco.mjtSensor.mjSENS_CONTACT)
    sensor.objtype, sensor.objname = SUBTREE, ROBOT
    if body:
        sensor.reftype, sensor.refname = SUBTREE, body
    sensor.intprm[0], sensor.intprm[1], sensor.intprm[2] = FOUND, KEEP_FIRST, ONE_SLOT


def add_force_sensor(spec: mujoco.MjSpec, name: str, body: str, *, on: str = "") -> None:
    """Add a sensor of the net contact force (N, world) that ``body`` and what it carries exert on other things.

    Args:
        spec: the scene. name: of the sensor. body: ``GRIPPER`` for what a sensor in the wrist feels, ``ROBOT`` for
            what is done to an object, with whatever part of the robot.
        on: count only forces on this body and what it carries; empty for all.
    """
    sensor = spec.add_sensor(name=name, type=mujoco.mjtSensor.mjSENS_CONTACT)
    sensor.objtype, sensor.objname = SUBTREE, body
    if on:
        sensor.reftype, sensor.refname = SUBTREE, on
    sensor.intprm[0], sensor.intprm[1], sensor.intprm[2] = FORCE, NET_FORCE, ONE_SLOT
