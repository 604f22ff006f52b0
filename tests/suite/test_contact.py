"""Contacts give no energy, forces are felt through a low-pass, and half the physics step leads the same way."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.arrays import length
from aerial_il.robots.parts.collision import WORLD
from aerial_il.robots.parts.gripper import PAD_CONTACT
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.physics import episode_state
from aerial_il.suite.physics.force_sensing import BANDWIDTH_HZ, keep_sample, sense_forces
from aerial_il.suite.props.contact import GRASPABLE
from aerial_il.suite.props.cube import add_cube
from aerial_il.suite.props.table import TABLE_HEIGHT_M, add_table
from aerial_il.suite.scenario import Scenario
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


DT_S = 0.004


def respond(signal: np.ndarray) -> np.ndarray:
    """Readings (T,) of a force along x whose course is ``signal`` (T,)."""
    forces, found = np.zeros(4 * episode_state.MAX_FORCES), []
    for value in signal:
        sense_forces(np.array([value, 0.0, 0.0]), np.zeros(1, np.int64), forces, DT_S)
        found.append(forces[0])
    return np.array(found)


def test_a_step_is_felt_with_the_time_constant_of_the_bandwidth() -> None:
    readings = respond(np.full(100, 10.0))
    time = DT_S * np.arange(1, 101)
    np.testing.assert_allclose(readings, 10.0 * (1.0 - np.exp(-2.0 * math.pi * BANDWIDTH_HZ * time)))


@pytest.mark.parametrize("hertz", [1.0, 50.0])
def test_slow_forces_pass_and_fast_ones_do_not(hertz: float) -> None:
    time = DT_S * np.arange(1000)
    passed = np.abs(respond(np.sin(2.0 * math.pi * hertz * time))[500:]).max()
    assert passed > 0.98 if hertz < BANDWIDTH_HZ else passed < 0.4


def test_the_largest_and_every_reading_are_kept() -> None:
    forces, userdata = np.zeros(4 * episode_state.MAX_FORCES), np.zeros(episode_state.USERDATA_SIZE)
    readings = []
    for tick, value in enumerate((0.0, 40.0, 0.0, 0.0, 0.0)):
        raw = np.array([0.0, value, 0.0])
        sense_forces(raw, np.zeros(1, np.int64), forces, DT_S)
        keep_sample(raw, np.zeros(1, np.int64), forces, userdata, tick)
        readings.append(forces[1])
    assert forces[3 * episode_state.MAX_FORCES] == max(readings) == readings[1]
    samples = userdata[episode_state.SAMPLES].reshape(episode_state.SUBSTEPS, 6)
    np.testing.assert_array_equal(samples[:, 1], readings)
    np.testing.assert_array_equal(samples[:, 4], [0.0, 40.0, 0.0, 0.0, 0.0])


LIMIT_M = 0.01
SEEDS = np.arange(20_000, 20_016)
Flown = list[tuple[np.ndarray, np.ndarray, np.ndarray]]  # of each step: actions, who flew, tool positions


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["fa_hexa_arm4", "big_four_z1"])
def test_the_tool_goes_the_same_way_in_halved_steps(robot: str) -> None:
    scenario = Scenario(robot, "inspect_contact", "gusts")
    apart = _apart(scenario, _flown_by_expert(scenario), refinement=2)
    assert apart.max() <= LIMIT_M, f"largest distance of each flight, mm: {np.round(1e3 * apart, 1)}"


def test_a_refined_world_has_the_same_clock_and_another_last_bit() -> None:
    scenario = Scenario("fa_hexa_arm4", "inspect_contact", "gusts")
    coarse, fine = (BatchEnvironment(scenario, 1, refinement=parts) for parts in (1, 4))
    for env in (coarse, fine):
        env.reset(0)
        view = env.simulation.view
        hold = np.concatenate(
            [view.tool_pos, view.tool_mat[:, [0, 3, 6]], view.tool_mat[:, [1, 4, 7]], [[0.0]]], axis=1
        )
        for _ in range(10):
            env.step(hold)
    np.testing.assert_array_equal(fine.sim_time, coarse.sim_time)
    apart = length(fine.simulation.view.tool_pos - coarse.simulation.view.tool_pos)
    assert 0.0 < apart[0] < LIMIT_M


def _flown_by_expert(scenario: Scenario) -> Flown:
    env = BatchEnvironment(scenario, len(SEEDS))
    expert = aerial_il.expert(scenario.robot.name, scenario.task.name)
    env.reset(SEEDS)
    expert.attach(env)
    flying, flown = np.ones(len(SEEDS), bool), []
    while flying.any():
        action = expert.act({})
        result = env.step(action, flying)
        flown.append((action, flying, env.simulation.view.tool_pos.copy()))
        flying = flying & ~(result.info["success"] | result.terminated | result.truncated)
    return flown


def _apart(scenario: Scenario, flown: Flown, *, refinement: int) -> np.ndarray:
    """(n,) largest distance of each flight's tool from where it was, m, when its actions are flown again."""
    env = BatchEnvironment(scenario, len(SEEDS), refinement=refinement)
    env.reset(SEEDS)
    apart = np.zeros(len(SEEDS))
    for action, flying, tool in flown:
        env.step(action, flying)
        apart = np.maximum(apart, np.where(flying, length(env.simulation.view.tool_pos - tool), 0.0))
    return apart
