"""Masses, friction and rotor gains: drawn as documented, each by its own component, applied as physics has it."""

from __future__ import annotations

from functools import cache

import mujoco
import numpy as np
import pytest

from aerial_il.suite import tiers
from aerial_il.suite.episode.variation import FRICTION_FIELDS, MOTOR_FIELDS, PAYLOAD_FIELDS, Varied
from aerial_il.suite.scenario import Scenario

ROBOT, TASK = "fa_hexa_arm4", "pick_place"
SEEDS = range(400)


@cache
def nominal() -> mujoco.MjModel:
    return Scenario(ROBOT, TASK).compile()


def varied(tier: str) -> Varied:
    return Varied(nominal(), Scenario(ROBOT, TASK).robot, TASK, tiers.get(tier))


def test_calm_varies_nothing() -> None:
    assert varied("calm").fields == varied("gusts").fields == ()
    assert varied("gusts").values(varied("gusts").draw(3)) == {}


@pytest.mark.parametrize(
    ("tier", "fields"),
    [("calm+payload", PAYLOAD_FIELDS), ("calm+friction", FRICTION_FIELDS), ("calm+motors", MOTOR_FIELDS)],
)
def test_a_component_touches_its_own_fields_only(tier: str, fields: tuple[str, ...]) -> None:
    one = varied(tier)
    assert one.fields == fields
    values = one.values(one.draw(5))
    assert tuple(values) == fields
    assert all((values[name] != getattr(nominal(), name)).any() for name in fields if name != "dof_frictionloss")


def test_leaving_one_out_changes_no_other_draw() -> None:
    hard = varied("hard").draw(11)
    assert hard == varied("hard").draw(11) != varied("hard").draw(12)
    for name, kept in (("payload", "rotor_gain"), ("motors", "contact_friction"), ("friction", "object_mass")):
        assert getattr(varied(f"hard-{name}").draw(11), kept) == getattr(hard, kept)
    assert varied("calm+payload").draw(11).base_offset == hard.base_offset
    assert varied("hard-wind-latency-noise").draw(11) == hard


def test_draws_fill_their_ranges_evenly() -> None:
    one = varied("hard")
    drawn = [one.draw(seed) for seed in SEEDS]
    factors = np.array([[v.object_mass[0], v.contact_friction, v.joint_friction] for v in drawn])
    gains = np.array([v.rotor_gain for v in drawn])
    mass = np.array([v.base_mass for v in drawn]) / one.robot.vehicle.mass
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
    offsets = np.array([v.base_offset for v in drawn])
    assert (np.abs(offsets).max(axis=0) > 0.9 * np.array(one.robot.base.hub_size)).all()


def test_the_payload_makes_objects_and_base_heavier_as_a_point_mass_does() -> None:
    one, model = varied("calm+payload"), nominal()
    drawn = one.draw(8)
    values = one.values(drawn)
    base, cube = model.body("base").id, model.body("cube").id
    np.testing.assert_allclose(values["body_mass"][cube], drawn.object_mass[0] * model.body_mass[cube])
    np.testing.assert_allclose(values["body_inertia"][cube], drawn.object_mass[0] * model.body_inertia[cube])
    where, extra, own = np.array(drawn.base_offset), drawn.base_mass, model.body_mass[base]
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
    for name in PAYLOAD_FIELDS:
        np.testing.assert_array_equal(values[name][others], getattr(model, name)[others])


def test_friction_scales_sliding_of_every_contact_and_not_the_robots_joints() -> None:
    one, model = varied("calm+friction"), nominal()
    drawn = one.draw(2)
    values = one.values(drawn)
    np.testing.assert_allclose(values["geom_friction"][:, :2], drawn.contact_friction * model.geom_friction[:, :2])
    np.testing.assert_array_equal(values["geom_friction"][:, 2], model.geom_friction[:, 2])
    own = model.dof_jntid < one.robot.num_joints
    np.testing.assert_array_equal(values["dof_frictionloss"][own], model.dof_frictionloss[own])


def test_motor_gains_scale_rotors_alone() -> None:
    one, model = varied("calm+motors"), nominal()
    drawn, rotors = one.draw(2), one.robot.num_rotors
    values = one.values(drawn)["actuator_gainprm"]
    np.testing.assert_allclose(values[:rotors, 0], drawn.rotor_gain)
    np.testing.assert_array_equal(values[rotors:], model.actuator_gainprm[rotors:])
