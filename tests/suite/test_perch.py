"""Only who is held by its own grip, rotors at rest, for five seconds and flies off has perched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import aerial_il
from aerial_il import robots
from aerial_il.experts.perch import CLOSE, PerchExpert, thrust_share
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.props.perch import BAR_HALF_M
from aerial_il.suite.tasks.perch import DONE, ENOUGH_STEPS, SQUEEZE_N, STEPS, TASK
from tests.contract.registered import batch, fly_until_solved

ROBOT, N = "mini_quad_gripper", 3


@pytest.fixture(scope="module")
def standing() -> np.ndarray:
    """States of worlds in which the robot has just been perched for half a second."""
    worlds, expert = begun()
    while not (steps(worlds) >= 25).all():
        worlds.step(expert.act({}))
    return worlds.get_state()


def begun() -> tuple[BatchEnvironment, PerchExpert]:
    worlds, expert = batch(ROBOT, "perch"), aerial_il.expert(ROBOT, "perch")
    worlds.reset(30)
    expert.attach(worlds)
    expert.reset()
    return worlds, expert


def at_rotors(state: np.ndarray) -> BatchEnvironment:
    """The same worlds, in which an action is the rotors' thrusts, the joint and the gripper's opening."""
    worlds = batch(ROBOT, "perch", level="rotor")
    worlds.reset(30)
    worlds.set_state(state)
    memory(worlds)[:] = 0.0
    worlds.set_state(worlds.get_state())
    return worlds


def memory(worlds: BatchEnvironment) -> np.ndarray:
    return worlds.simulation.view.task_state


def steps(worlds: BatchEnvironment) -> np.ndarray:
    return memory(worlds)[:, STEPS]


def off(opening: float) -> np.ndarray:
    """Rotors off, the arm straight down."""
    return np.tile([0.0, 0.0, 0.0, 0.0, 0.5 * np.pi, opening], (N, 1))


def most(worlds: BatchEnvironment, action: np.ndarray, seconds: float) -> np.ndarray:
    """Repeat an action; return the largest number of steps (n,) for which it counted as perched."""
    largest = np.zeros(N)
    for _ in range(round(seconds / worlds.spec.control_dt_s)):
        worlds.step(action)
        largest = np.maximum(largest, steps(worlds))
    return largest


def test_held_with_rotors_off_counts_and_is_as_still_as_a_stand(standing: np.ndarray) -> None:
    worlds = at_rotors(standing)
    before = worlds.simulation.view.base_pos.copy()
    assert (most(worlds, off(0.0), 5.2) >= ENOUGH_STEPS).all()
    assert (memory(worlds)[:, DONE] == 1.0).all()
    assert (thrust_share(worlds.simulation.view) < 1e-9).all()
    np.testing.assert_allclose(worlds.simulation.view.base_pos, before, atol=0.005)


def test_to_stand_on_for_ever_is_no_success(standing: np.ndarray) -> None:
    worlds = at_rotors(standing)
    for _ in range(ENOUGH_STEPS + 100):
        assert not worlds.step(off(0.0)).info["success"].any()
    assert (memory(worlds)[:, DONE] == 1.0).all()


def test_with_an_open_gripper_on_the_bar_does_not_count(standing: np.ndarray) -> None:
    assert (most(at_rotors(standing), off(1.0), 2.0) <= 5).all(), "while the fingers open"


def test_fingers_that_touch_without_a_squeeze_do_not_count(standing: np.ndarray) -> None:
    worlds = at_rotors(standing)
    touching = BAR_HALF_M[1] / worlds.simulation.view.robot.gripper.stroke
    assert (most(worlds, off(touching), 2.0) <= 5).all(), "while the grip slackens"


def test_wedged_between_open_fingers_does_not_count(standing: np.ndarray) -> None:
    worlds = at_rotors(standing)
    most(worlds, off(1.0), 0.1)
    view, felt = worlds.simulation.view, 0.0
    for lean in np.linspace(-0.8, 0.8, 17):
        view.qpos[:, 3:7] = [np.cos(0.5 * lean), np.sin(0.5 * lean), 0.0, 0.0]
        view.qpos[:, :3] = view.site_pos("perch") + 0.14 * np.array([0.0, -np.sin(lean), np.cos(lean)])
        view.qvel[:] = 0.0
        worlds.set_state(worlds.get_state())
        assert (most(worlds, off(1.0), 0.2) == 0.0).all()
        felt = max(felt, float(np.linalg.norm(view.force(0), axis=1).max()))
    assert felt > SQUEEZE_N, "a finger is pressed on the bar"


def test_on_the_ground_with_rotors_off_does_not_count() -> None:
    worlds = batch(ROBOT, "perch", level="rotor")
    worlds.reset(30)
    view = worlds.simulation.view
    view.qpos[:, :3] = [1.0, 1.0, 0.14]
    worlds.set_state(worlds.get_state())
    assert (most(worlds, off(0.0), 2.0) == 0.0).all()
    assert (view.base_pos[:, 2] < 0.2).all()


@pytest.mark.parametrize("opening", [0.0, 1.0])
def test_falling_past_the_bar_does_not_count(opening: float) -> None:
    worlds = batch(ROBOT, "perch", level="rotor")
    worlds.reset(30)
    view = worlds.simulation.view
    beside = view.site_mat("perch")[:, [1, 4, 7]] * 0.1
    view.qpos[:, :3] = view.site_pos("perch") + beside + np.array([0.0, 0.0, 0.4])
    worlds.set_state(worlds.get_state())
    assert (most(worlds, off(opening), 1.0) == 0.0).all()
    assert (view.base_pos[:, 2] < view.site_pos("perch")[:, 2]).all()


def test_rotors_that_run_do_not_count_whatever_they_are_told(standing: np.ndarray) -> None:
    worlds = at_rotors(standing)
    hover = off(0.0)
    hover[:, :4] = 0.3 * worlds.simulation.view.robot.vehicle.mass * 9.81 / 4.0
    assert (most(worlds, hover, 1.0) <= 2).all(), "until they have run up"
    view = worlds.simulation.view
    view.rotor_command[:] = 0.0
    assert (thrust_share(view) > 0.25).all(), "what they give counts, not what they are told"


def test_a_break_starts_the_five_seconds_anew(standing: np.ndarray) -> None:
    worlds = at_rotors(standing)
    assert (most(worlds, off(0.0), 4.5) < ENOUGH_STEPS).all()
    on = off(0.0)
    on[:, :4] = 1.0
    most(worlds, on, 0.2)
    assert (most(worlds, off(0.0), 4.5) < ENOUGH_STEPS).all()
    assert (memory(worlds)[:, DONE] == 0.0).all()


def test_who_leaves_early_has_not_perched(standing: np.ndarray) -> None:
    worlds, expert = begun()
    worlds.set_state(standing)
    expert.reset()
    for leaving in (False, True):
        for _ in range(200):
            memory(worlds)[:, DONE] = float(leaving)  # which is how the expert knows that it may fly off
            action = expert.act({})
            memory(worlds)[:, DONE] = 0.0
            assert not worlds.step(action).info["success"].any()
    assert (worlds.simulation.view.tool_pos[:, 2] > worlds.simulation.view.site_pos("perch")[:, 2] + 0.25).all()


def test_the_expert_grips_anew_when_it_has_slipped_off() -> None:
    worlds, expert = begun()
    while not (expert.phase == CLOSE).any():
        worlds.step(expert.act({}))
    view = worlds.simulation.view
    view.qpos[:, 2] += 0.3
    worlds.set_state(worlds.get_state())
    assert fly_until_solved(worlds, expert).all()


def test_who_would_tip_over_or_cannot_reach_around_the_bar_is_refused() -> None:
    robot = robots.get(ROBOT)
    aside = replace(robot, arm=replace(robot.arm, mount=(0.05, 0.0, -0.03)))
    narrow = replace(robot, gripper=replace(robot.gripper, stroke=0.025))
    assert TASK.infeasibility(robot) is None
    assert "4.5 cm beside the fingers" in str(TASK.infeasibility(aside))
    assert "opens 5.0 cm" in str(TASK.infeasibility(narrow))
