"""A beam counts when it lies in both hooks, let go and at rest, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

import aerial_il
from aerial_il.experts.set_down import RELEASE
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.props.frame import BEAM_HALF_M, HOOK_M, WALL_M
from tests.contract.registered import batch, fly_until_solved
from tests.suite.test_long_tasks import ROBOT, put, started, wait

TASK = "assemble_frame"


def laid(worlds: BatchEnvironment, offset: tuple[float, float, float], *, turn: float = 0.0, roll: float = 0.0) -> None:
    """Put the beam ``offset`` m (along, beside, over) from where it lies in the hooks, turned and rolled by rad."""
    view = worlds.simulation.view
    mats = view.site_mat("frame").reshape(-1, 3, 3)
    yaw = np.arctan2(mats[:, 1, 0], mats[:, 0, 0]) + turn
    pos = view.site_pos("frame") + mats @ np.array(offset)
    put(worlds, "beam", pos)
    pose, _ = view.free_joint("beam")
    c, s, cr, sr = np.cos(0.5 * yaw), np.sin(0.5 * yaw), np.cos(0.5 * roll), np.sin(0.5 * roll)
    view.qpos[:, pose.start + 3 : pose.stop] = np.stack([c * cr, c * sr, s * sr, s * cr], axis=1)
    worlds.set_state(worlds.get_state())


def test_a_beam_dropped_from_just_above_the_hooks_counts() -> None:
    worlds = started(TASK)
    laid(worlds, (0.01, 0.003, WALL_M + BEAM_HALF_M[2] + 0.008), turn=np.pi)
    assert not wait(worlds, 0.4)["success"].any(), "not before half a second"
    assert wait(worlds, 0.6)["success"].all(), "the slopes let it in, either end first"


@pytest.mark.parametrize(
    ("offset", "turn", "roll"),
    [
        ((0.0, 0.0, WALL_M + 2.0 * BEAM_HALF_M[2]), 0.5 * np.pi, 0.0),  # across
        ((0.0, 0.03, WALL_M + BEAM_HALF_M[2] + 0.01), 0.0, 0.0),  # on top of the walls, or beside them
        ((0.0, 0.0, WALL_M + BEAM_HALF_M[2] + 0.01), 0.15, 0.0),  # one end out of its hook
        ((0.05, 0.0, 0.001), 0.0, 0.0),  # hardly in one of them
        ((0.0, 0.0, 0.001), 0.0, np.pi),  # upside down
    ],
)
def test_a_beam_that_lies_wrongly_does_not_count(offset: tuple[float, float, float], turn: float, roll: float) -> None:
    worlds = started(TASK)
    laid(worlds, offset, turn=turn, roll=roll)
    assert not wait(worlds, 1.5)["success"].any()


def test_a_beam_in_one_hook_does_not_count() -> None:
    worlds = started(TASK)
    laid(worlds, (2.0 * HOOK_M, 0.0, 0.001))
    assert not wait(worlds, 1.5)["success"].any()


def test_a_beam_that_is_held_in_the_hooks_does_not_count() -> None:
    worlds, expert = batch(ROBOT, TASK), aerial_il.expert(ROBOT, TASK)
    worlds.reset(30)
    expert.attach(worlds)
    expert.reset()
    action, solved, arrived = expert.act({}), np.zeros(3, bool), np.zeros(3, bool)
    for _ in range(400):
        new = expert.act({})
        landing = (expert.phase == RELEASE) & ~arrived
        arrived |= landing
        action = np.where(arrived[:, None], action, new)  # press on it, the gripper closed
        action[landing, 2] -= 0.02
        solved |= worlds.step(action).info["success"]
    assert arrived.all()
    assert worlds.simulation.reassess().subtasks[:, -1].all(), "it is in both hooks"
    assert not solved.any()


def test_walls_hold_a_beam_that_is_pushed_sideways() -> None:
    worlds = started(TASK)
    laid(worlds, (0.0, 0.0, 0.0))
    view, model = worlds.simulation.view, worlds.simulation.worlds.model
    push = worlds.simulation.worlds.bind("xfrc_applied").reshape(3, model.nbody, 6)[:, model.body("beam").id]
    mats = view.site_mat("frame").reshape(3, 3, 3)
    push[:, :3] = 3.0 * mats[:, :, 1] + [0.0, 0.0, -3.0]
    assert wait(worlds, 1.0)["success"].all()
    push[:] = 0.0
    assert wait(worlds, 0.1)["success"].all()
    for i in range(3):
        data = worlds.simulation.worlds.data(i)
        assert data.contact.dist[: data.ncon].min() > -0.0005


def test_a_beam_that_falls_off_a_hook_is_laid_in_anew() -> None:
    worlds, expert = batch(ROBOT, TASK), aerial_il.expert(ROBOT, TASK)
    worlds.reset(30)
    expert.attach(worlds)
    expert.reset()
    worlds.simulation.view.qpos[:, 2] += 0.2
    laid(worlds, (0.0, 0.0, WALL_M + BEAM_HALF_M[2] + 0.002), turn=0.12)
    assert fly_until_solved(worlds, expert).all()


def test_a_beam_on_the_floor_is_lost() -> None:
    worlds = started(TASK)
    put(worlds, "beam", np.tile([0.6, 0.0, 0.02], (3, 1)))
    assert wait(worlds, 0.1)["dropped"].all()
