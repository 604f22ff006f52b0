"""Masses, friction and rotor gains: drawn as documented, each by its own component, applied as physics has it."""

from __future__ import annotations

from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest

from aerial_il import robots
from aerial_il.core.seeding import episode_rng
from aerial_il.suite import tiers
from aerial_il.suite.disturbances.nominal import ROTOR_GAIN, Nominal
from aerial_il.suite.scenario import Scenario

ROBOT, TASK = "fa_hexa_arm4", "pick_place"
SEEDS = range(400)


@cache
def nominal() -> mujoco.MjModel:
    return Scenario(ROBOT, TASK).compile()


def draw(component: str, seed: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What a component draws for an episode, and the fields of the model that come of it."""
    part, rng = tiers.get(f"calm+{component}").parts[component], episode_rng(ROBOT, TASK, component, seed)
    model = Nominal(nominal(), robots.get(ROBOT))
    fields = {name: model.field(name) for name in part.varies}
    return part.vary(fields, model, rng), fields


@pytest.mark.parametrize("component", ["payload", "friction", "motors"])
def test_a_component_changes_its_fields(component: str) -> None:
    _, fields = draw(component, 5)
    model = Nominal(nominal(), robots.get(ROBOT))
    assert all((value != model.field(n)).any() for n, value in fields.items() if n != "dof_frictionloss")
    assert draw(component, 11)[0] == draw(component, 11)[0] != draw(component, 12)[0]


def test_draws_fill_their_ranges_evenly() -> None:
    robot = robots.get(ROBOT)
    drawn = [draw("payload", seed)[0] | draw("friction", seed)[0] | draw("motors", seed)[0] for seed in SEEDS]
    factors = np.array([[v["object_mass"][0], v["contact_friction"], v["joint_friction"]] for v in drawn])
    gains = np.array([v["rotor_gain"] for v in drawn])
    mass = np.array([v["base_mass"] for v in drawn]) / robot.vehicle.mass
    for values, low, high in ((factors, 0.7, 1.3), (gains, 0.95, 1.05), (mass, 0.0, 0.05)):
        width = high - low
        assert (low <= values).all()
        assert (values <= high).all()
        np.testing.assert_allclose(values.min(axis=0), low, atol=0.03 * width)
        np.testing.assert_allclose(values.max(axis=0), high, atol=0.03 * width)
        np.testing.assert_allclose(values.mean(axis=0), 0.5 * (low + high), atol=0.06 * width)
        np.testing.assert_allclose(values.std(axis=0), width / np.sqrt(12.0), rtol=0.1)
    every = np.concatenate([factors, gains], axis=1)
    assert np.abs(np.corrcoef(every.T) - np.eye(every.shape[1])).max() < 0.2, "independent of each other"
    offsets = np.array([v["base_offset"] for v in drawn])
    assert (np.abs(offsets).max(axis=0) > 0.9 * np.array(robot.base.hub_size)).all()


def test_the_payload_is_a_point_mass_on_objects_and_base() -> None:
    model, (drawn, values) = nominal(), draw("payload", 8)
    base, cube = model.body("base").id, model.body("cube").id
    np.testing.assert_allclose(values["body_mass"][cube], drawn["object_mass"][0] * model.body_mass[cube])
    np.testing.assert_allclose(values["body_inertia"][cube], drawn["object_mass"][0] * model.body_inertia[cube])
    where, extra, own = np.array(drawn["base_offset"]), drawn["base_mass"], model.body_mass[base]
    np.testing.assert_allclose(values["body_mass"][base], own + extra)
    np.testing.assert_allclose(values["body_ipos"][base], where * extra / (own + extra))
    rot = np.empty(9)
    mujoco.mju_quat2Mat(rot, values["body_iquat"][base])
    rot = rot.reshape(3, 3)
    about_centre = rot @ np.diag(values["body_inertia"][base]) @ rot.T
    com = values["body_ipos"][base]
    about_origin = about_centre + (own + extra) * (com @ com * np.eye(3) - np.outer(com, com))
    expected = np.diag(model.body_inertia[base]) + extra * (where @ where * np.eye(3) - np.outer(where, where))
    np.testing.assert_allclose(about_origin, expected, atol=1e-12)
    others = np.setdiff1d(np.arange(model.nbody), [base, cube])
    for name in values:
        np.testing.assert_array_equal(values[name][others], getattr(model, name)[others])


def test_friction_scales_contacts_and_not_the_robots_joints() -> None:
    model, (drawn, values) = nominal(), draw("friction", 2)
    np.testing.assert_allclose(values["geom_friction"][:, :2], drawn["contact_friction"] * model.geom_friction[:, :2])
    np.testing.assert_array_equal(values["geom_friction"][:, 2], model.geom_friction[:, 2])
    own = model.dof_jntid < robots.get(ROBOT).num_joints
    np.testing.assert_array_equal(values["dof_frictionloss"][own], model.dof_frictionloss[own])


def test_motor_gains_scale_rotors_alone() -> None:
    drawn, fields = draw("motors", 2)
    np.testing.assert_array_equal(fields.pop(ROTOR_GAIN), drawn["rotor_gain"])
    assert not fields
