"""Contacts take energy and never give any: what is dropped does not rise higher, whatever touches whatever."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from aerial_il.control.vehicle import GRAVITY
from aerial_il.robots.parts.collision import WORLD
from aerial_il.robots.parts.gripper import PAD_CONTACT
from aerial_il.suite.props.contact import GRASPABLE
from aerial_il.suite.props.cube import add_cube
from aerial_il.suite.props.table import TABLE_HEIGHT_M, add_table
from aerial_il.suite.scene import set_physics
from aerial_il.suite.timing import PHYSICS_DT_S

BOX = mujoco.mjtGeom.mjGEOM_BOX
SURFACES = {"table": {}, "graspable": GRASPABLE, "pad": PAD_CONTACT}


def scene(surface: str, dropped: str) -> mujoco.MjModel:
    """A table with a plate of some surface on it, and a free body above: the cube, or a block of the pads' rubber."""
    spec = mujoco.MjSpec()
    set_physics(spec)
    spec.option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    add_table(spec)
    if surface != "table":
        plate = {"pos": [0, 0, TABLE_HEIGHT_M - 0.004], "size": [0.3, 0.3, 0.005]}
        spec.worldbody.add_geom(name="plate", type=BOX, **plate, **{**WORLD, **SURFACES[surface]})
    if dropped == "cube":
        add_cube(spec)
    else:
        body = spec.worldbody.add_body(name="cube")
        body.add_freejoint(name="cube")
        body.add_geom(name="cube", type=BOX, size=[0.026, 0.003, 0.015], mass=0.02, **WORLD, **PAD_CONTACT)
    return spec.compile()


def fall(model: mujoco.MjModel, seed: int, seconds: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """Energy (J) after each step of a tumbling fall, and whether anything touched in it."""
    rng, data = np.random.default_rng(seed), mujoco.MjData(model)
    data.qpos[:3] = [0.0, 0.0, TABLE_HEIGHT_M + rng.uniform(0.08, 0.5)]
    quat = rng.standard_normal(4)
    data.qpos[3:7] = quat / np.linalg.norm(quat)
    data.qvel[:3], data.qvel[3:6] = 0.3 * rng.standard_normal(3), 5.0 * rng.standard_normal(3)
    energy, touching = [], []
    for _ in range(round(seconds / PHYSICS_DT_S)):
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        energy.append(data.energy.sum())
        touching.append(data.ncon > 0)
    return np.array(energy), np.array(touching)


@pytest.mark.parametrize("dropped", ["cube", "pad"])
@pytest.mark.parametrize("surface", SURFACES)
def test_what_is_dropped_never_gains_energy(surface: str, dropped: str) -> None:
    model = scene(surface, dropped)
    scale = model.body_mass[model.body("cube").id] * GRAVITY * 0.1  # of a fall from 10 cm
    for seed in range(6):
        energy, touching = fall(model, seed)
        assert touching.any()
        assert energy.max() <= energy[0] + 0.01 * scale, "never above what it started with"
        free = np.flatnonzero(~touching)  # in contact, the contact holds elastic energy that MuJoCo does not count
        assert np.diff(energy[free]).max() <= 0.02 * scale, "no bounce gives more than came in"
        assert energy[-50:].max() - energy[-50:].min() <= 0.01 * scale, "it comes to rest"
