"""Kinematics and dynamics against MuJoCo; the disturbance observer meets payload, tables and walls."""

import mujoco
import numpy as np
import pytest

from aerial_il import robots
from aerial_il.control.dynamics import (
    inverse_dynamics,
    momentum,
    rotational_inertia,
    tool_jacobian,
    tool_pose,
)
from aerial_il.control.vehicle import GRAVITY, Vehicle
from aerial_il.core.rotations import mat_from_yaw
from aerial_il.robots.parts.collision import WORLD
from tests.control.in_the_air import Flight
from tests.control.nominal import VEHICLES, compile_nominal, each_vehicle, random_state
from tests.robots.test_robots import compiled


@each_vehicle
def test_the_tool_is_where_mujoco_has_it(vehicle: Vehicle) -> None:
    model, rng = compile_nominal(vehicle), np.random.default_rng(0)
    for _ in range(20):
        state = random_state(model, vehicle, rng)
        tool, rot = tool_pose(vehicle.record, state.frames)
        np.testing.assert_allclose(tool, state.data.site("tool").xpos, atol=1e-12)
        np.testing.assert_allclose(rot, state.data.site("tool").xmat, atol=1e-12)


@each_vehicle
def test_the_jacobian_is_mujocos_and_that_of_finite_differences(vehicle: Vehicle) -> None:
    model, rng, count = compile_nominal(vehicle), np.random.default_rng(1), len(vehicle.link_mass)
    for _ in range(10):
        state = random_state(model, vehicle, rng)
        jacobian, theirs = np.empty((6, 4 + count)), np.empty((6, model.nv))
        tool_jacobian(vehicle.record, state.frames, state.pos, jacobian)
        mujoco.mj_jacSite(model, state.data, theirs[:3], theirs[3:], model.site("tool").id)
        np.testing.assert_allclose(jacobian[:, :3], theirs[:, :3], atol=1e-12)
        np.testing.assert_allclose(jacobian[:, 4:], theirs[:, 6:], atol=1e-12)
        tool = state.data.site("tool").xpos.copy()
        turned = mujoco.MjData(model)
        turned.qpos[:] = state.data.qpos
        for column in range(count):
            turned.qpos[7 + column] += 1e-6
            mujoco.mj_kinematics(model, turned)
            np.testing.assert_allclose(jacobian[:3, 4 + column], (turned.site("tool").xpos - tool) / 1e-6, atol=1e-5)
            turned.qpos[7 + column] -= 1e-6
        about_base = np.reshape(mat_from_yaw(1e-6), (3, 3)) @ (tool - state.pos) + state.pos
        np.testing.assert_allclose(jacobian[:3, 3], (about_base - tool) / 1e-6, atol=1e-5)


@each_vehicle
def test_momentum_is_mujocos(vehicle: Vehicle) -> None:
    model, rng = compile_nominal(vehicle), np.random.default_rng(3)
    for _ in range(10):
        state = random_state(model, vehicle, rng)
        mujoco.mj_subtreeVel(model, state.data)
        linear, angular, com, mass = momentum(
            vehicle.record, state.frames, state.pos, state.rot, state.vel, state.omega, state.joint_vel
        )
        base = state.data.body("base")
        np.testing.assert_allclose(mass, model.body_subtreemass[1])
        np.testing.assert_allclose(com, base.subtree_com, atol=1e-12)
        np.testing.assert_allclose(linear, mass * base.subtree_linvel, atol=1e-12)
        np.testing.assert_allclose(angular, base.subtree_angmom, atol=1e-12)


@each_vehicle
def test_inverse_dynamics_is_mujocos(vehicle: Vehicle) -> None:
    model, rng, count = compile_nominal(vehicle), np.random.default_rng(4), len(vehicle.link_mass)
    for _ in range(20):
        state = random_state(model, vehicle, rng)
        data = state.data
        data.qacc[:] = rng.uniform(-5, 5, model.nv)
        mujoco.mj_inverse(model, data)
        rot = np.reshape(state.rot, (3, 3))
        torques = np.empty(count)
        force, torque = inverse_dynamics(
            vehicle.record, state.frames, state.pos, state.rot, state.omega, state.joint_vel,
            tuple(data.qacc[:3]), tuple(rot @ data.qacc[3:6]), data.qacc[6:].copy(), torques,
        )  # fmt: skip
        np.testing.assert_allclose(force, data.qfrc_inverse[:3], atol=1e-9)
        np.testing.assert_allclose(torque, rot @ data.qfrc_inverse[3:6], atol=1e-9)
        np.testing.assert_allclose(torques, data.qfrc_inverse[6:], atol=1e-9)


@each_vehicle
def test_rotational_inertia_is_the_block_of_mujocos_mass_matrix(vehicle: Vehicle) -> None:
    model, rng = compile_nominal(vehicle), np.random.default_rng(5)
    for _ in range(10):
        state = random_state(model, vehicle, rng)
        matrix = np.empty((model.nv, model.nv))
        mujoco.mj_fullM(model, state.data, matrix)
        rot = np.reshape(state.rot, (3, 3))
        alpha = rng.uniform(-5, 5, 3)
        torque = rotational_inertia(vehicle.record, state.frames, state.pos, state.rot, tuple(rot @ alpha))
        np.testing.assert_allclose(torque, rot @ matrix[3:6, 3:6] @ alpha, atol=1e-9)


def test_the_simulated_robots_are_close_to_their_nominal_models() -> None:
    """Fingers move in the simulator and are welded in the nominal model: equal mass, centre of mass within 2 mm."""
    for name, vehicle in VEHICLES.items():
        model, nominal = compiled(robots.get(name)), compile_nominal(vehicle)
        data, reference = mujoco.MjData(model), mujoco.MjData(nominal)
        for posture in (vehicle.rest_down, vehicle.rest_forward):
            data.qpos[7 : 7 + len(posture)] = reference.qpos[7:] = posture
            mujoco.mj_forward(model, data)
            mujoco.mj_forward(nominal, reference)
            assert np.isclose(model.body_subtreemass[1], nominal.body_subtreemass[1])
            np.testing.assert_allclose(data.subtree_com[1], reference.subtree_com[1], atol=0.002)
            np.testing.assert_allclose(data.site("tool").xpos, reference.site("tool").xpos, atol=1e-12)


ROBOTS = ("fa_hexa_arm4", "ua_quad_arm4")
each_robot = pytest.mark.parametrize("robot", ROBOTS)


def payload(mass: float):
    """A function that welds a ball of ``mass`` kg to the hand, between the fingers."""

    def furnish(spec: mujoco.MjSpec) -> None:
        hand = spec.site("tool").parent
        ball = hand.add_body(name="payload", pos=spec.site("tool").pos)
        ball.add_geom(
            name="payload", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02, 0, 0], mass=mass, contype=0, conaffinity=0
        )

    return furnish


def plate(pos: np.ndarray, pitch: float):
    """A function that puts a fixed plate there, m, square to a tool that points down by ``pitch`` rad."""

    def furnish(spec: mujoco.MjSpec) -> None:
        spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 10.0
        quat = [np.cos(0.5 * pitch), 0.0, np.sin(0.5 * pitch), 0.0]
        box = mujoco.mjtGeom.mjGEOM_BOX
        spec.worldbody.add_geom(name="plate", type=box, pos=pos, quat=quat, size=[0.02, 0.15, 0.15], **WORLD)

    return furnish


def contact_force(flight: Flight) -> np.ndarray:
    """(3,) what the plate exerts on the robot, world, N."""
    total, plate_id = np.zeros(3), flight.model.geom("plate").id
    for k, contact in enumerate(flight.data.contact):
        if plate_id in contact.geom:
            force = np.zeros(6)
            mujoco.mj_contactForce(flight.model, flight.data, k, force)
            total += (1.0 if contact.geom[0] == plate_id else -1.0) * contact.frame.reshape(3, 3).T @ force[:3]
    return total


@each_robot
@pytest.mark.parametrize("gripper", [0.0, 1.0], ids=["closed", "open"])
def test_a_payload_of_a_tenth_of_the_weight_is_carried(robot: str, gripper: float) -> None:
    vehicle = robots.get(robot).vehicle
    mass = 0.1 * vehicle.mass
    flight = Flight(robot, furnish=payload(mass))
    action = flight.pose()
    action[-1] = gripper
    flight.fly(action, 6.0)
    assert np.linalg.norm(flight.tool - action[:3]) < 0.02
    assert flight.tilt < np.deg2rad(5.0)
    assert np.linalg.norm(flight.data.qvel[:6]) < 0.02
    np.testing.assert_allclose(
        flight.controller.disturbance[:3], [0.0, 0.0, -mass * GRAVITY], atol=0.05 * mass * GRAVITY
    )
    flight.fly(action + np.array([0.3, 0.0, 0.1, *np.zeros(7)]), 5.0)
    assert np.linalg.norm(flight.tool - action[:3] - [0.3, 0.0, 0.1]) < 0.025


@each_robot
@pytest.mark.parametrize("pitch_deg", [90.0, 45.0], ids=["table", "slanted wall"])
def test_pressing_on_a_table_or_a_wall_stays_calm_and_bounded(robot: str, pitch_deg: float) -> None:
    """Sent 3 cm into it, the vehicle leans on it, holds still, and comes away as it came."""
    pitch, away = np.deg2rad(pitch_deg), robots.get(robot).gripper.finger_length + 0.05
    axis = np.array([np.cos(pitch), 0.0, -np.sin(pitch)])
    before = Flight(robot).tool + np.array([0.2 * np.cos(pitch), 0.0, 0.0])
    flight = Flight(robot, furnish=plate(before + (away + 0.02) * axis, pitch))
    free = np.array([*before, *axis, 0.0, 1.0, 0.0, 0.0])
    flight.fly(free, 4.0)
    pressed = free.copy()
    pressed[:3] += (away + 0.03) * axis
    flight.fly(pressed, 5.0)
    pushes, tilts = [], []
    for _ in range(100):  # means over 20 ms, for rigid contacts rattle from one physics step to the next
        ticks = []
        for _ in range(5):
            flight.fly(pressed, 0.004)
            ticks.append(-contact_force(flight) @ axis)
        pushes.append(np.mean(ticks))
        tilts.append(flight.tilt)
    weight = flight.vehicle.mass * GRAVITY
    assert 0.03 * weight < np.mean(pushes) < 0.7 * weight
    assert np.std(pushes) < 0.2 * weight
    assert max(tilts) < np.deg2rad(25.0)
    flight.fly(free, 5.0)
    assert np.linalg.norm(flight.tool - before) < 0.005
    assert np.linalg.norm(flight.controller.disturbance[:3]) < 0.02 * weight
