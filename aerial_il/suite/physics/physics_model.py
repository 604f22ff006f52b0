"""A scene without what only eyes need: the model that many worlds are flown with, the same bits for less."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.core.errors import AerialError

BODY_FIELDS = ("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_simple", "body_sameframe")


class ModelMismatchError(AerialError):
    """A scene whose physics depends on what was thought to be there for eyes alone."""


def physics_model(full: mujoco.MjModel, xml: str) -> mujoco.MjModel:
    """Compile the scene ``xml`` without cameras, lights and geoms that touch nothing.

    Args:
        full: the model compiled from the whole scene; masses and inertias are taken over from it.

    Raises:
        ModelMismatchError: bodies, joints, sites or sensors would differ.
    """
    spec = mujoco.MjSpec.from_string(xml)
    for body in spec.bodies:
        if body.name and body.name != "world":
            _keep_inertia(body, full)
        for thing in (*(geom for geom in body.geoms if not _touches(geom)), *body.cameras, *body.lights):
            spec.delete(thing)
    model = spec.compile()
    for name in BODY_FIELDS:
        if not np.array_equal(getattr(model, name), getattr(full, name)):
            raise ModelMismatchError(f"{spec.modelname}: {name} depends on geoms that touch nothing.")
    return model


def _touches(geom: mujoco.MjsGeom) -> bool:
    return bool(geom.contype or geom.conaffinity)


def _keep_inertia(body: mujoco.MjsBody, full: mujoco.MjModel) -> None:
    """Give a body the inertia that all of its geoms together have."""
    compiled = full.body(body.name)
    body.explicitinertial = True
    body.mass, body.ipos, body.iquat, body.inertia = (
        float(compiled.mass[0]), compiled.ipos.copy(), compiled.iquat.copy(), compiled.inertia.copy()
    )  # fmt: skip
