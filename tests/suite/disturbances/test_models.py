"""Disturbances as their sources have them: wind, masses, friction and rotor gains."""

from __future__ import annotations

from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest

from aerial_il import robots
from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.kernels import kernel
from aerial_il.core.seeding import episode_rng
from aerial_il.suite import tiers
from aerial_il.suite.disturbances import wind
from aerial_il.suite.disturbances.noise import Noise
from aerial_il.suite.disturbances.nominal import ROTOR_GAIN, Nominal
from aerial_il.suite.disturbances.wind import Air, Wind, advance_wind, air_about, intensities, length_scales, mean_share
from aerial_il.suite.scenario import Scenario

AIR = Air(speed=10.0, quadratic_drag=0.05, span=0.7, pressure_spread=0.02)
HEIGHT = 6.0
SIGMA = AIR.speed * np.array(intensities(HEIGHT))
MEAN = AIR.speed * mean_share(HEIGHT)
TIME = np.array(length_scales(HEIGHT)) / MEAN


@kernel
def _record(air, state, height, seed, dt, result):
    """Rows of ``found``: velocity (3) and filter states of the centre of pressure (3)."""
    for tick in range(result.shape[0]):
        advance_wind(air, state, height, seed, tick, dt)
        result[tick, :3] = state[8:11]
        result[tick, 3:] = state[5:8]


def series(dt: float, steps: int, seed: int = 1, air: Air = AIR, height: float = HEIGHT) -> np.ndarray:
    """(steps, 6) turbulence along, across and up (m/s), then the centre of pressure in standard deviations."""
    state, result = wind.start_wind(np.random.default_rng(seed)), np.empty((steps, 6))
    state[wind.DIRECTION] = 0.0
    _record(air, state, height, float(seed), dt, result)
    result[:, 0] -= air.speed * mean_share(height)
    return result


def test_the_mean_wind_follows_the_logarithmic_profile() -> None:
    assert mean_share(20 * 0.3048) == pytest.approx(1.0)
    assert mean_share(1.0) == pytest.approx(np.log(1.0 / 0.04572) / np.log(20.0 / 0.15))
    assert mean_share(0.0) == mean_share(3 * 0.3048), "the standard's profile ends at 3 ft"
    heights = np.linspace(1.0, 100.0, 50)
    assert (np.diff([mean_share(h) for h in heights]) > 0.0).all()


def test_scales_and_intensities_are_those_of_the_standard() -> None:
    """At 1000 ft the standard's low-altitude turbulence becomes isotropic; near the ground it is flat."""
    np.testing.assert_allclose(length_scales(304.8), 304.8, rtol=1e-9)
    np.testing.assert_allclose(intensities(304.8), 0.1, rtol=1e-9)
    feet = 50.0
    share = 0.177 + 0.000823 * feet
    np.testing.assert_allclose(
        np.array(length_scales(feet * 0.3048)) / 0.3048, [feet / share**1.2, feet / share**1.2, feet]
    )
    np.testing.assert_allclose(intensities(feet * 0.3048), [0.1 / share**0.4, 0.1 / share**0.4, 0.1])
    assert length_scales(0.5) == length_scales(3.048), "the standard's turbulence ends at 10 ft"
    assert intensities(0.5) == intensities(3.048)


@pytest.mark.parametrize("dt", [0.004, 0.02, 0.3])
def test_variance_and_correlation_are_those_of_theory(dt: float) -> None:
    result = series(dt, 150_000)
    result = result[:, :3] / SIGMA
    samples = 0.5 * len(result) * dt / TIME
    np.testing.assert_array_less(np.abs(result.var(axis=0) - 1.0), 5.0 / np.sqrt(samples) + 0.02)
    for k in range(3):
        lag = max(1, round(TIME[k] / dt))
        ratio = lag * dt / TIME[k]
        expected = np.exp(-ratio) * (1.0 if k == 0 else 1.0 - 0.5 * ratio)
        correlation = np.mean(result[lag:, k] * result[:-lag, k]) / result[:, k].var()
        assert correlation == pytest.approx(expected, abs=5.0 / np.sqrt(samples[k]) + 0.02)


def test_the_spectra_are_drydens() -> None:
    dt, size = 0.02, 4096
    result = series(dt, 300 * size)[:, :3].reshape(300, size, 3)
    power = np.mean(np.abs(np.fft.rfft(result * np.hanning(size)[None, :, None], axis=1)) ** 2, axis=0)
    density = power * 2.0 * dt / np.sum(np.hanning(size) ** 2)  # one-sided, per Hz
    frequency = np.fft.rfftfreq(size, dt)
    band = (frequency > 0.05) & (frequency < 2.0)
    for k in range(3):
        x = (2.0 * np.pi * frequency[band] * TIME[k]) ** 2
        shape = 4.0 / (1.0 + x) if k == 0 else 2.0 * (1.0 + 3.0 * x) / (1.0 + x) ** 2
        expected = SIGMA[k] ** 2 * TIME[k] * shape
        assert np.mean(density[band, k] / expected) == pytest.approx(1.0, abs=0.05)
        np.testing.assert_allclose(density[band, k], expected, rtol=0.4)


def test_components_are_independent_and_start_as_they_go_on() -> None:
    np.testing.assert_allclose(np.corrcoef(series(0.3, 100_000).T), np.eye(6), atol=0.03)
    first = np.array([series(0.02, 1, seed)[0] for seed in range(3000)])
    np.testing.assert_allclose(first.std(axis=0), [*SIGMA, 1.0, 1.0, 1.0], rtol=0.08)
    np.testing.assert_allclose(first.mean(axis=0), 0.0, atol=0.12)


def test_no_gust_exceeds_three_standard_deviations() -> None:
    result = series(0.5, 60_000)
    limit = 3.0 * SIGMA
    assert (np.abs(result[:, :3]) <= limit + 1e-9).all()
    assert (np.abs(result[:, :3]).max(axis=0) > 0.999 * limit).all(), "a bound that is never met binds nothing"


def test_it_blows_where_its_direction_says() -> None:
    state = wind.start_wind(np.random.default_rng(3))
    state[: wind.VELOCITY] = 0.0
    advance_wind(AIR, state, HEIGHT, 1.0, 0, 1e-9)
    heading = np.arctan2(state[9], state[8])
    assert heading == pytest.approx(state[wind.DIRECTION], abs=0.01)
    assert np.hypot(state[8], state[9]) == pytest.approx(MEAN, rel=0.01)
    directions = [wind.start_wind(np.random.default_rng(s))[wind.DIRECTION] for s in range(400)]
    assert np.abs(np.mean(np.exp(1j * np.array(directions)))) < 0.15, "from every side alike"


@pytest.mark.parametrize("share", [0.06, 0.13])
@pytest.mark.parametrize("robot", [name for name in robots.names() if robots.get(name).vehicle.drag.any()])
def test_the_largest_gust_drags_with_a_share_of_the_weight(robot: str, share: float) -> None:
    vehicle = robots.get(robot).vehicle
    air = air_about(vehicle, share)
    mean = air.speed * mean_share(wind.WORK_HEIGHT_M)
    gust = mean + 3.0 * air.speed * intensities(wind.WORK_HEIGHT_M)[0]
    weak, strong = (v * (0.5 * (vehicle.drag[0] + vehicle.drag[1]) + air.quadratic_drag * v) for v in (mean, gust))
    assert strong - weak == pytest.approx(share * vehicle.mass * GRAVITY)
    assert 1.5 < mean < 12.0, "a wind in which such vehicles fly"


def test_still_air_is_still() -> None:
    vehicle = robots.get("ua_quad_arm4").vehicle
    assert air_about(vehicle, 0.0).speed == 0.0
    ideal = air_about(vehicle._replace(drag=np.zeros(3)), 0.13)
    assert ideal.speed == ideal.quadratic_drag == 0.0, "what has no drag feels no wind"


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


def test_a_base_that_is_fixed_is_refused_what_it_does_not_feel() -> None:
    for part in (Noise(), Wind()):
        assert "stands fixed" in (part.unfelt(robots.get("z1")) or "")
        assert part.unfelt(robots.get("ua_quad_arm4")) is None
