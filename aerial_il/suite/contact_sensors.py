"""Contact sensors, by which tasks know who touches whom."""

from __future__ import annotations

import mujoco

FOUND, KEEP_FIRST, ONE_SLOT = 1, 0, 1  # data, reduction and number of MuJoCo's contact sensor


def add_contact_sensor(spec: mujoco.MjSpec, name: str, *, body: str = "", geoms: tuple[str, str] | None = None) -> None:
    """Add a sensor that counts contacts: of a body's own geoms with anything, or between two geoms."""
    sensor = spec.add_sensor(name=name, type=mujoco.mjtSensor.mjSENS_CONTACT)
    if geoms is None:
        sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_BODY, body
    else:
        sensor.objtype = sensor.reftype = mujoco.mjtObj.mjOBJ_GEOM
        sensor.objname, sensor.refname = geoms
    sensor.intprm[0], sensor.intprm[1], sensor.intprm[2] = FOUND, KEEP_FIRST, ONE_SLOT
