"""Kinematics, momentum and inverse dynamics against MuJoCo, on the nominal model and on the simulated robots."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il import robots
from aerial_il.control.dynamics import (
    inverse_dynamics,
    momentum,
    rotational_inertia,
    tool_jacobian,
    tool_pose,
)
from aerial_il.control.vehicle import Vehicle
from aerial_il.core.rotations import mat_from_yaw
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
