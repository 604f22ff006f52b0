"""A scene without what only eyes need: the model that many worlds are flown with, the same bits for less."""

from __future__ import annotations

from itertools import combinations

import mujoco
import numpy as np

from aerial_il.core.errors import AerialError
from aerial_il.suite.physics.rotors import NAME

BODY_FIELDS = ("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_simple", "body_sameframe")
MOST_PAIRS = 40  # beyond which MuJoCo's search is faster


class ModelMismatchError(AerialError):
    """A scene whose physics depends on what was thought to be there for eyes alone."""


def physics_model(full: mujoco.MjModel, xml: str, *, pairs: bool = True) -> mujoco.MjModel:
    """Compile the scene ``xml`` without cameras, lights, geoms that touch nothing and sites of rotors.

    Stages of a step that have nothing to do in it are switched off.

    Args:
        full: the model compiled from the whole scene; masses and inertias are taken over from it.
        pairs: name the pairs of geoms that may touch, where they are few, in place of a search. The friction of named
            pairs does not follow that of the geoms.

    Raises:
        ModelMismatchError: bodies, joints, sites or sensors would differ.
    """
    spec = mujoco.MjSpec.from_string(xml)
    for body in spec.bodies:
        if body.name and body.name != "world":
            _keep_inertia(body, full)
        rotors = (site for site in body.sites if site.name.startswith(NAME("")))
        looks = (geom for geom in body.geoms if not (geom.contype or geom.conaffinity))
        for thing in (*looks, *body.cameras, *body.lights, *rotors):
            spec.delete(thing)
    model = spec.compile()
    if (
        pairs
        and not (model.geom_priority.any() or model.geom_margin.any())
        and 0 < len(touching := _may_touch(model)) <= MOST_PAIRS
    ):
        _name_pairs(spec, model, touching)
        model = spec.compile()
    for name in BODY_FIELDS:
        if not np.array_equal(getattr(model, name), getattr(full, name)):
            raise ModelMismatchError(f"{spec.modelname}: {name} depends on geoms that touch nothing.")
    model.opt.disableflags |= _idle(model)
    return model


def _idle(model: mujoco.MjModel) -> int:
    """Flags that switch off what this model has nothing of."""
    flag, option = mujoco.mjtDisableBit, model.opt
    passive = (
        model.jnt_stiffness,
        model.dof_damping,
        model.tendon_stiffness,
        model.tendon_damping,
        model.body_gravcomp,
    )
    needed = {
        flag.mjDSBL_ACTUATION: model.nu,
        flag.mjDSBL_EQUALITY: model.neq,
        flag.mjDSBL_FRICTIONLOSS: model.dof_frictionloss.any() or model.tendon_frictionloss.any(),
        flag.mjDSBL_LIMIT: model.jnt_limited.any() or model.tendon_limited.any(),
        flag.mjDSBL_SPRING | flag.mjDSBL_DAMPER: any(map(np.any, passive)) or option.density or option.viscosity,
    }
    return sum(int(bit) for bit, there in needed.items() if not there)


def _may_touch(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Geoms of every pair whose contacts MuJoCo would look for."""
    weld = model.body_weldid[model.geom_bodyid]
    parent = model.body_weldid[model.body_parentid[weld]]
    found = []
    for one, other in combinations(range(model.ngeom), 2):
        meant = model.geom_contype[[one, other]] & model.geom_conaffinity[[other, one]]
        related = weld[one] == parent[other] or weld[other] == parent[one]
        held = weld[one] == weld[other] or (related and weld[one] != 0 != weld[other])
        if meant.any() and not held:
            found.append((one, other))
    return found


def _name_pairs(spec: mujoco.MjSpec, model: mujoco.MjModel, touching: list[tuple[int, int]]) -> None:
    """Name the pairs, with contacts as MuJoCo makes them of two geoms of equal priority, and leave no others."""
    for one, other in (sorted(pair, key=lambda geom: model.geom_type[geom]) for pair in touching):
        share = model.geom_solmix[one] / (model.geom_solmix[one] + model.geom_solmix[other])
        sliding, turning, rolling = np.maximum(model.geom_friction[one], model.geom_friction[other])
        spec.add_pair(
            geomname1=model.geom(one).name,
            geomname2=model.geom(other).name,
            condim=max(model.geom_condim[one], model.geom_condim[other]),
            friction=[sliding, sliding, turning, rolling, rolling],
            solref=share * model.geom_solref[one] + (1.0 - share) * model.geom_solref[other],
            solimp=share * model.geom_solimp[one] + (1.0 - share) * model.geom_solimp[other],
        )
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0


def _keep_inertia(body: mujoco.MjsBody, full: mujoco.MjModel) -> None:
    """Give a body the inertia that all of its geoms together have."""
    compiled = full.body(body.name)
    body.explicitinertial = True
    body.mass, body.ipos, body.iquat, body.inertia = (
        float(compiled.mass[0]), compiled.ipos.copy(), compiled.iquat.copy(), compiled.inertia.copy()
    )  # fmt: skip
