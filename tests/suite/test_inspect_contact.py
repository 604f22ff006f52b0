"""The force that inspection demands is the one that the plate feels; letting go forgets where contact began."""

from __future__ import annotations

import numpy as np
import pytest

import aerial_il
from aerial_il.experts.expert import Expert
from aerial_il.experts.inspect_contact import in_touch, normal, normal_force, slip, squareness
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.episode import measured
from aerial_il.suite.physics import episode_state
from aerial_il.suite.props.plate import MASS_KG, PRELOAD_N, STIFFNESS
from aerial_il.suite.tasks.inspect_contact import (
    FORCE_N,
    FORCE_TOLERANCE_N,
    IN_BAND,
    PRESSED,
    SLIP_M,
    InspectContact,
)
from tests.contract.registered import batch, fly_until_solved

CELL = ("fa_hexa_arm4", "inspect_contact")


@pytest.fixture
def pressing() -> tuple[BatchEnvironment, Expert]:
    """Worlds in which the tool has been on the plate for a while."""
    worlds, expert = batch(*CELL), aerial_il.expert(*CELL)
    worlds.reset(0)
    expert.attach(worlds)
    since = np.zeros(3)
    while (since < 40).any():
        worlds.step(expert.act({}))
        since = np.where(in_touch(worlds.simulation.view), since + 1, 0)
    return worlds, expert


def test_the_measured_force_is_that_of_the_spring(pressing: tuple[BatchEnvironment, Expert]) -> None:
    worlds, expert = pressing
    view, felt, sprung = worlds.simulation.view, [], []
    for _ in range(50):
        worlds.step(expert.act({}))
        felt.append(normal_force(view))
        weight = MASS_KG * 9.81 * normal(view)[:, 2]
        sprung.append(PRELOAD_N + STIFFNESS * view.joint("plate")[0] - weight)
    np.testing.assert_allclose(np.mean(felt, axis=0), np.mean(sprung, axis=0), atol=0.2)
    np.testing.assert_allclose(np.mean(felt, axis=0), FORCE_N, atol=0.5)


def test_success_needs_all_three_seconds(pressing: tuple[BatchEnvironment, Expert]) -> None:
    worlds, expert = pressing
    dwell = round(InspectContact.dwell_s / worlds.spec.control_dt_s)
    held, success = worlds.simulation.view.userdata[:, episode_state.DWELL].copy(), np.zeros(3, bool)
    for _ in range(dwell + 100):
        result = worlds.step(expert.act({}))
        held = np.where(result.info["subtasks"].all(axis=1), held + 1, 0)
        np.testing.assert_array_equal(result.info["success"], held >= dwell)
        success |= result.info["success"]
    assert success.any()


def test_one_reading_out_of_the_band_spoils_it(
    pressing: tuple[BatchEnvironment, Expert],
) -> None:
    worlds, _ = pressing
    view = worlds.simulation.view
    samples = view.userdata[:, episode_state.SAMPLES].reshape(3, episode_state.SUBSTEPS, 6)
    samples[:, :, :3] = -FORCE_N * normal(view)[:, None]
    assert worlds.simulation.reassess().subtasks[:, 3].all()
    samples[1, 2, :3] *= 1.5
    assert worlds.simulation.reassess().subtasks[:, 3].tolist() == [True, False, True]


def test_the_raw_share_is_that_of_the_solver_since_contact_began(pressing: tuple[BatchEnvironment, Expert]) -> None:
    worlds, expert = pressing
    simulation, view = worlds.simulation, worlds.simulation.view
    view.task_state[:, [PRESSED, IN_BAND]] = 0.0
    address, inside = view.address("plate_force"), []
    for step in range(20):
        action = expert.act({})
        if step >= 10:
            action[1, :3] -= 0.05 * normal(view)[1]  # pressed too hard
        simulation.receive(action)
        for _ in range(episode_state.SUBSTEPS):
            simulation.fly(1)
            raw = simulation.worlds.bind("sensordata")[:, address : address + 3]
            inside.append(np.abs(-(raw * normal(view)).sum(axis=1) - FORCE_N) <= FORCE_TOLERANCE_N)
        simulation.settle()
    share = simulation.reassess().force_in_band_raw
    assert in_touch(view).all()
    np.testing.assert_allclose(share, np.mean(inside, axis=0))
    assert 0.0 < share[1] < share[0]


def test_an_oblique_tool_or_a_slipped_one_does_not_count(pressing: tuple[BatchEnvironment, Expert]) -> None:
    worlds, expert = pressing
    view = worlds.simulation.view
    view.task_state[0, :3] += 1.5 * SLIP_M * view.site_mat("plate")[0, [0, 3, 6]]  # contact began farther up the plate
    assert np.linalg.norm(slip(view)[0]) > SLIP_M
    action = expert.act({})
    tilted = np.deg2rad(15.0)
    action[1, 3:6] = np.cos(tilted) * action[1, 3:6] + np.sin(tilted) * view.site_mat("plate")[1, [0, 3, 6]]
    for _ in range(40):
        worlds.step(action)
    assert squareness(view)[1] < np.cos(np.deg2rad(8.0))
    assert measured.truth(worlds.simulation.task.kernels.solved)(view)[[0, 1]].tolist() == [False, False]


def test_letting_go_forgets_the_contact(pressing: tuple[BatchEnvironment, Expert]) -> None:
    worlds, expert = pressing
    view = worlds.simulation.view
    began = view.task_state[:, :3].copy()
    away = expert.act({})
    away[:, :3] += 0.08 * normal(view)
    for _ in range(60):
        obs = worlds.step(away).obs
    assert not in_touch(view).any()
    assert not obs["slip"].any()
    assert fly_until_solved(worlds, expert).all()
    assert (np.linalg.norm(view.task_state[:, :3] - began, axis=1) > 1e-4).all()
