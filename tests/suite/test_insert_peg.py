"""The peg fits its bore with a millimetre of play all round, rests there, and may be picked up from the table."""

from __future__ import annotations

import numpy as np
import pytest

import aerial_il
from aerial_il.experts import insert_peg
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.props import TABLE_HEIGHT_M
from aerial_il.suite.props.peg import FLOOR_M, PEG_LENGTH_M, PEG_RADIUS_M
from tests.contract.registered import batch, fly_until_solved

ROBOT = "fa_hexa_arm4"


def put_peg(worlds: BatchEnvironment, pos: np.ndarray, quat: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)) -> None:
    """Put the peg of every world at ``pos`` (n, 3), at rest."""
    view = worlds.simulation.view
    pose, speed = view.free_joint("peg")
    view.qpos[:, pose] = np.concatenate([pos, np.tile(quat, (view.n, 1))], axis=1)
    view.qvel[:, speed] = 0.0
    worlds.set_state(worlds.get_state())


def hover(worlds: BatchEnvironment, steps: int) -> np.ndarray:
    """Stay in place for ``steps``; return who succeeded at the end, (n,)."""
    obs = worlds.observe()
    action = np.concatenate([obs["ee_pos"], obs["ee_rot6d"], np.ones((worlds.num_envs, 1))], axis=1)
    for _ in range(steps):
        worlds.step(action)
    return worlds.simulation.reassess().success


def test_a_peg_let_go_in_the_mouth_slides_in_and_comes_to_rest() -> None:
    worlds = batch(ROBOT, "insert_peg")
    worlds.reset(30)
    view = worlds.simulation.view
    hole = view.site_pos("hole").copy()
    put_peg(worlds, hole + np.array([0.0005, 0.0, 0.5 * PEG_LENGTH_M]))
    assert not hover(worlds, 10).any(), "not before it has stayed there"
    assert hover(worlds, 60).all()
    _, speed = view.free_joint("peg")
    assert np.abs(view.qvel[:, speed]).max() < 0.05, "no jitter"
    lowest = insert_peg.lower_end(view)[:, 2] - TABLE_HEIGHT_M
    np.testing.assert_allclose(lowest, FLOOR_M, atol=1e-3)


@pytest.mark.parametrize(("offset", "fits"), [(0.0, True), (0.0007, True), (0.0025, False)])
def test_the_play_is_a_millimetre_all_round(offset: float, fits: bool) -> None:
    worlds = batch(ROBOT, "insert_peg")
    worlds.reset(30)
    view = worlds.simulation.view
    upright = view.site_pos("hole") + np.array([0.0, 0.0, -0.02 + 0.5 * PEG_LENGTH_M])
    for angle in np.arange(8) * np.pi / 4:
        put_peg(worlds, upright + offset * np.array([np.cos(angle), np.sin(angle), 0.0]))
        touching = worlds.data(0).ncon > 0
        assert touching != fits


def test_depth_counts_the_full_width_inside_the_bore_only() -> None:
    worlds = batch(ROBOT, "insert_peg")
    worlds.reset(30)
    view = worlds.simulation.view
    hole = view.site_pos("hole").copy()
    for below, expected in ((-0.01, 0.0), (PEG_RADIUS_M, 0.0), (PEG_RADIUS_M + 0.03, 0.03)):
        put_peg(worlds, hole + np.array([0.0, 0.0, 0.5 * PEG_LENGTH_M - below]))
        np.testing.assert_allclose(insert_peg.depth(view), expected, atol=1e-9)
    put_peg(worlds, hole + np.array([0.05, 0.0, -0.03]))
    assert not insert_peg.depth(view).any(), "beside the socket"


def test_the_expert_picks_up_a_peg_that_lies_on_the_table() -> None:
    worlds = batch(ROBOT, "insert_peg")
    expert = aerial_il.expert(ROBOT, "insert_peg")
    expert.attach(worlds)
    worlds.reset(30)
    expert.reset()
    view = worlds.simulation.view
    between = 0.5 * (view.site_pos("hole") + view.site_pos("stand"))
    between[:, 2] = TABLE_HEIGHT_M + PEG_RADIUS_M
    put_peg(worlds, between, (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0))
    assert fly_until_solved(worlds, expert).all()
