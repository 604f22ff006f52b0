"""The physics is that of a real vehicle: weight, lag, drag torque, reaction, air."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from aerial_il import robots
from aerial_il.control.allocation import wrench_matrix
from aerial_il.control.vehicle import GRAVITY, Vehicle
from aerial_il.core.rotations import IDENTITY
from aerial_il.suite.environment import AerialEnvironment
from aerial_il.suite.physics.aerodynamics import GROUND_EFFECT, air_wrench, follow, ground_effect, quadratic_drag
from aerial_il.suite.physics.hooks import EFFECTS
from tests.contract.registered import CELLS, batch, hold_actions, single

STEP_S = 0.02
FLYING = [name for name in robots.names() if not robots.get(name).fixed]
each_robot = pytest.mark.parametrize("robot", FLYING)
each_armed = pytest.mark.parametrize("robot", [name for name in FLYING if robots.get(name).num_joints])
each_in_air = pytest.mark.parametrize("robot", [r for r in robots.names() if robots.get(r).vehicle.drag.any()])


def task_of(robot: str) -> str:
    """A task that the robot can do and that starts at rest."""
    return "reach" if (robot, "reach") in CELLS else "track"


def rotor_world(robot: str) -> tuple[AerialEnvironment, Vehicle, np.ndarray]:
    """A world at a random start, its vehicle, and an action with all rotors off and the arm at rest."""
    env = single(robot, task_of(robot), "calm", "rotor")
    env.reset(seed=2)
    vehicle = env.simulation.robot.vehicle
    off = np.concatenate([np.zeros(len(vehicle.rotor_max)), vehicle.rest_down, [1.0]])[: env.spec.action.size]
    return env, vehicle, off


@each_robot
def test_hovering_takes_the_weight(robot: str) -> None:
    worlds = batch(robot, task_of(robot))
    worlds.reset(0)
    vehicle = worlds.simulation.robot.vehicle
    weight = worlds.model.body_subtreemass[worlds.model.body("base").id] * GRAVITY
    assert weight == pytest.approx(vehicle.mass * GRAVITY)
    stay = hold_actions(worlds)
    lift = []
    for k in range(150):
        worlds.step(stay)
        if k >= 50:
            lift.append(worlds.simulation.view.thrust @ vehicle.rotor_axis[:, 2])
    np.testing.assert_allclose(np.mean(lift), weight, rtol=0.01)


@each_robot
def test_without_thrust_it_falls_freely(robot: str) -> None:
    env, _, off = rotor_world(robot)
    env.simulation.view.thrust[:] = 0.0
    before, steps = env.get_state(), 10
    for _ in range(steps):
        env.step(off)
    assert env.simulation.view.base_vel[0, 2] == pytest.approx(-GRAVITY * steps * STEP_S, rel=0.03)
    env.physics.model.opt.gravity[2] = 0.0
    try:
        env.set_state(before)
        env.step(off)
        assert abs(env.simulation.view.base_vel[0, 2]) < 1e-3
    finally:
        env.physics.model.opt.gravity[2] = -GRAVITY


@each_robot
def test_rotors_rise_and_fall_with_their_own_time_constants(robot: str) -> None:
    env, vehicle, action = rotor_world(robot)
    thrust, rotors = env.simulation.view.thrust[0], len(vehicle.rotor_max)
    start = 0.3 * vehicle.rotor_max[0]
    for target, tau in ((0.8, vehicle.rotor_tau_up), (0.1, vehicle.rotor_tau_down)):
        env.reset(seed=2)
        thrust[:] = start
        action[:rotors] = target * vehicle.rotor_max
        env.step(action)
        expected = action[0] + (start - action[0]) * np.exp(-STEP_S / tau)
        np.testing.assert_allclose(thrust, expected, rtol=1e-9)


@each_robot
def test_each_rotor_pushes_and_twists_as_the_controller_believes(robot: str) -> None:
    env, vehicle, off = rotor_world(robot)
    believed = wrench_matrix(vehicle.rotor_pos, vehicle.rotor_axis, vehicle.rotor_drag_ratio)
    view, applied = env.simulation.view, env.physics.data.qfrc_applied
    for i in range(len(vehicle.rotor_max)):
        env.reset(seed=2)
        rot = view.base_mat.reshape(3, 3).copy()
        view.thrust[:] = 0.0
        view.thrust[0, i] = 1.0
        env.simulation.receive(off[None])
        env.simulation.fly(1)
        found = np.concatenate([rot.T @ applied[:3], applied[3:6]])
        np.testing.assert_allclose(found, believed[:, i], atol=1e-3, err_msg="the ground adds a little")
    own_axis = np.einsum("ri,ir->r", vehicle.rotor_axis, believed[3:]) - np.einsum(
        "ri,ri->r", vehicle.rotor_axis, np.cross(vehicle.rotor_pos, vehicle.rotor_axis)
    )
    np.testing.assert_allclose(own_axis, vehicle.rotor_drag_ratio, atol=1e-12)
    assert abs(vehicle.rotor_drag_ratio.sum()) < 1e-12, "drag torques must cancel in hover"


@each_robot
def test_rotors_push_no_harder_than_they_can(robot: str) -> None:
    vehicle = robots.get(robot).vehicle
    for limit, beyond in ((vehicle.rotor_max, 5.0), (vehicle.rotor_min, -5.0)):
        thrust = np.zeros(len(limit))
        follow(vehicle.record, limit + beyond, 1.0, thrust)
        np.testing.assert_array_equal(thrust, limit)


@each_armed
def test_a_swinging_arm_turns_the_base_and_conserves_momentum(robot: str) -> None:
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.gravity = [0, 0, 0]
    spec.option.timestep = 0.0005
    robots.get(robot).add_to(spec)
    model = spec.compile()
    data, vehicle = mujoco.MjData(model), robots.get(robot).vehicle
    joints, rotors = len(vehicle.link_mass), len(vehicle.rotor_max)
    data.qpos[7 : 7 + joints] = data.ctrl[rotors : rotors + joints] = vehicle.rest_down
    swung = int(np.flatnonzero(np.abs(vehicle.link_axis[:, 1]) > 0.5)[0])  # the first joint that pitches
    towards = 1.0 if vehicle.rest_down[swung] + 0.8 < vehicle.joint_high[swung] else -1.0
    data.ctrl[rotors + swung] += 0.8 * towards
    for _ in range(300):
        mujoco.mj_step(model, data)
    mujoco.mj_subtreeVel(model, data)
    scale = vehicle.link_mass.sum() * 0.2
    np.testing.assert_allclose(vehicle.mass * data.subtree_linvel[1], 0.0, atol=1e-2 * scale)
    np.testing.assert_allclose(data.subtree_angmom[1], 0.0, atol=1e-2 * scale)
    pitch = 2.0 * np.arctan2(data.qpos[5], data.qpos[3])
    assert pitch * towards * vehicle.link_axis[swung, 1] < -0.005, "the base must turn against the arm"


def test_ground_effect_follows_its_curve() -> None:
    radius = 0.15
    for height in (0.1, 0.2, 0.5, 2.0):
        assert ground_effect(height, radius) == pytest.approx(
            1.0 / (1.0 - GROUND_EFFECT * (radius / (4 * height)) ** 2)
        )
    assert ground_effect(0.15, radius) > ground_effect(0.3, radius) > ground_effect(3.0, radius) > 1.0
    assert ground_effect(0.0, radius) == ground_effect(0.5 * radius, radius) < 1.1
    assert ground_effect(100.0, radius) == pytest.approx(1.0, abs=1e-6)


@each_in_air
def test_the_air_brakes_and_carries(robot: str) -> None:
    vehicle, still = robots.get(robot).vehicle, np.zeros(1, EFFECTS)[0]
    air = quadratic_drag(vehicle)
    off, hover = np.zeros(len(vehicle.rotor_max)), vehicle.mixer[:, 2] * vehicle.mass * GRAVITY
    vel = (1.0, -2.0, 0.5)
    drag, torque = air_wrench(vehicle.record, air, still, (0.0, 0.0, 50.0), IDENTITY, vel, off)
    coefficients = vehicle.drag + air * np.linalg.norm(vel)
    np.testing.assert_allclose(drag, -coefficients * vel)
    np.testing.assert_allclose(torque, 0.0)
    sideways = (0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)  # yawed by a quarter turn
    turned, _ = air_wrench(vehicle.record, air, still, (0.0, 0.0, 50.0), sideways, (1.0, 0.0, 0.0), off)
    np.testing.assert_allclose(turned, [-vehicle.drag[1] - air, 0.0, 0.0], atol=1e-12)
    rest = (0.0, 0.0, 0.0)
    low, _ = air_wrench(vehicle.record, air, still, (0.0, 0.0, vehicle.rotor_radius), IDENTITY, rest, hover)
    high, _ = air_wrench(vehicle.record, air, still, (0.0, 0.0, 3.0), IDENTITY, rest, hover)
    assert 0.005 * vehicle.mass * GRAVITY < low[2] < 0.1 * vehicle.mass * GRAVITY
    assert 0.0 < high[2] < 1e-3 * vehicle.mass * GRAVITY


@each_in_air
def test_the_wind_pushes_as_flying_against_it_would(robot: str) -> None:
    vehicle, air = robots.get(robot).vehicle.record, quadratic_drag(robots.get(robot).vehicle)
    still, wind = np.zeros(2, EFFECTS)
    off, high = np.zeros(vehicle.num_rotors), (0.0, 0.0, 50.0)
    wind["wind"] = [4.0, -3.0, 0.5]
    blown, torque = air_wrench(vehicle, air, wind, high, IDENTITY, (0.0, 0.0, 0.0), off)
    flown, _ = air_wrench(vehicle, air, still, high, IDENTITY, (-4.0, 3.0, -0.5), off)
    np.testing.assert_allclose(blown, flown)
    np.testing.assert_allclose(torque, 0.0, err_msg="the centre of pressure is in the middle")
    with_it, _ = air_wrench(vehicle, air, wind, high, IDENTITY, (4.0, -3.0, 0.5), off)
    np.testing.assert_allclose(with_it, 0.0, atol=1e-12, err_msg="who drifts along feels no wind")
    wind["lever"] = [0.01, -0.005, 0.02]
    _, torque = air_wrench(vehicle, air, wind, high, IDENTITY, (0.0, 0.0, 0.0), off)
    np.testing.assert_allclose(torque, np.cross(wind["lever"], blown))
    wind["force"], wind["torque"] = [1.0, 2.0, 3.0], [0.1, 0.2, 0.3]
    pushed, turned = air_wrench(vehicle, air, wind, high, IDENTITY, (0.0, 0.0, 0.0), off)
    np.testing.assert_allclose(np.subtract(pushed, blown), [1.0, 2.0, 3.0])
    np.testing.assert_allclose(np.subtract(turned, torque), [0.1, 0.2, 0.3])


@each_in_air
def test_an_unknown_mass_leaves_the_air_where_it_acts(robot: str) -> None:
    """The force of the air is about the base's origin, wherever the centre of mass has gone."""
    env = single(robot, task_of(robot), "calm+wind+payload")
    env.reset(seed=3)
    model, data = env.physics.model.ptr, env.physics.data.ptr
    assert np.abs(model.body_ipos[model.body("base").id]).max() > 1e-4
    env.step(env.spec.action.clip(np.zeros(env.spec.action.size)))
    assert np.abs(data.qfrc_applied[:6]).max() > 0.0
    assert not data.xfrc_applied.any()
    assert not data.qfrc_applied[6:].any()
