"""Window and bulb: dirt goes by sliding with the right force alone, a lamp goes in by turning in its thread alone."""

from __future__ import annotations

import numpy as np
import pytest

import aerial_il
from aerial_il.experts import screw_bulb, wipe_window
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.props.bulb import LEAD_M
from aerial_il.suite.props.window import PATCHES, PRELOAD_N, STIFFNESS
from aerial_il.suite.tasks.wipe_window import BREAKING_N, BROKEN, FORCE_N, LEFT, PRESSED
from tests.contract.registered import batch, fly_until_solved

WIPE, SCREW = ("fa_hexa_arm4", "wipe_window"), ("fa_hexa_arm4", "screw_bulb")


def flown_until(cell: tuple[str, str], phase: int, steps: int) -> BatchEnvironment:
    """Worlds that the expert has flown for some steps beyond the first of a phase."""
    worlds, expert = batch(*cell), aerial_il.expert(*cell)
    worlds.reset(30)
    expert.attach(worlds)
    expert.reset()
    since = np.zeros(3, int)
    while since.min() < steps:
        worlds.step(expert.act({}), since < steps)
        since += expert.phase == phase
    return worlds


DIRTY = float((1 << 44) - 1)  # everywhere


def pressed_with(
    worlds: BatchEnvironment, newtons: float, stroke_m: float, steps: int, *, opening: float = 0.0, settling: int = 0
) -> np.ndarray:
    """Push the pane in as far as ``newtons`` do, and send the fingertips ``stroke_m`` ahead, up the pane.

    Returns:
        (n,) cells wiped of a pane that is dirty all over once ``settling`` steps are over.
    """
    view = worlds.simulation.view
    mat = view.site_mat("pane").copy()
    up, across, out = mat[:, [0, 3, 6]], mat[:, [1, 4, 7]], mat[:, [2, 5, 8]]
    start = wipe_window.tip_on_pane(view)
    for step in range(settling + steps):
        if step == settling:
            view.task_state[:, LEFT] = DIRTY
        tip, (travel, _) = wipe_window.tip_on_pane(view), view.joint("pane")
        aside = start - tip
        along = np.full(3, stroke_m) if stroke_m else aside[:, 0]
        depth = (newtons - PRELOAD_N) / STIFFNESS - travel + tip[:, 2]
        there = view.tool_pos + along[:, None] * up + aside[:, 1:2] * across - depth[:, None] * out
        worlds.step(np.concatenate([there, -out, across, np.full((3, 1), opening)], axis=1))
    return np.array([44 - f"{int(left):b}".count("1") for left in view.task_state[:, LEFT]])


@pytest.fixture
def on_pane() -> BatchEnvironment:
    """Worlds in which the fingertips have just met the pane."""
    return flown_until(WIPE, wipe_window.WIPE, 15)


def test_a_stroke_with_five_newtons_wipes(on_pane: BatchEnvironment) -> None:
    assert (pressed_with(on_pane, FORCE_N, 0.02, 60) >= 2).all()


@pytest.mark.parametrize(
    ("newtons", "stroke_m", "opening"), [(2.0, 0.02, 0.0), (FORCE_N, 0.0, 0.0), (FORCE_N, 0.02, 1.0)]
)
def test_a_light_or_still_or_open_hand_wipes_nothing(
    on_pane: BatchEnvironment, newtons: float, stroke_m: float, opening: float
) -> None:
    assert not pressed_with(on_pane, newtons, stroke_m, 20, opening=opening, settling=50).any()
    assert (on_pane.simulation.view.task_state[:, PRESSED] > 50).all(), "it does touch the pane"


def test_too_hard_a_push_breaks_the_pane_for_good(on_pane: BatchEnvironment) -> None:
    view = on_pane.simulation.view
    pressed_with(on_pane, 60.0, 0.0, 60)
    assert (view.peak_force() > BREAKING_N).all()
    assert (view.task_state[:, BROKEN] > 0.0).all()
    view.task_state[:, LEFT] = 0.0
    pressed_with(on_pane, 0.0, 0.0, 0, settling=40)
    assert on_pane.simulation.reassess().dropped.all()
    assert not on_pane.simulation.reassess().success.any()


def test_dirt_that_is_wiped_off_leaves_the_picture() -> None:
    worlds = batch(*WIPE)
    worlds.reset(30)
    view = worlds.simulation.view
    patches = [view.mocap_id(f"dirt_{k}") for k in range(PATCHES)]
    assert (view.mocap_pos[:, patches, 2] > 0.4).all()
    expert = aerial_il.expert(*WIPE)
    expert.attach(worlds)
    assert fly_until_solved(worlds, expert).all()
    gone = (view.mocap_pos[:, patches, 2] < 0.0).sum(axis=1)
    np.testing.assert_allclose(gone / PATCHES, wipe_window.wiped_share(view))


def test_success_ends_when_the_bulb_is_screwed_out_again() -> None:
    worlds, expert = batch(*SCREW), aerial_il.expert(*SCREW)
    worlds.reset(30)
    expert.attach(worlds)
    assert fly_until_solved(worlds, expert).all()
    turn, _ = worlds.simulation.view.joint("bulb_turn")
    travel, _ = worlds.simulation.view.joint("bulb_travel")
    turn -= np.pi
    travel -= 0.5 * LEAD_M
    worlds.set_state(worlds.get_state())
    hold = expert.act({})
    for _ in range(5):
        assert not worlds.step(hold).info["success"].any()


def test_a_push_or_a_turn_that_is_let_go_screws_nothing_in() -> None:
    worlds = flown_until(SCREW, screw_bulb.TURN, 20)
    view = worlds.simulation.view
    before = view.joint("bulb_turn")[0].copy()
    down = np.concatenate([view.tool_pos, view.tool_mat[:, 0::3], view.tool_mat[:, 1::3], np.zeros((3, 1))], axis=1)
    down[:, 2] -= 0.08
    for _ in range(60):
        worlds.step(down)
    assert (-view.force()[:, 2] > 8.0).any(), "it does push"
    np.testing.assert_allclose(view.joint("bulb_turn")[0], before, atol=0.2)
    worlds.reset(30)
    _, rate = view.joint("bulb_turn")
    rate[:] = 20.0
    worlds.set_state(worlds.get_state())
    stay = down.copy()
    stay[:, :3] = view.tool_pos
    for _ in range(50):
        worlds.step(stay)
    turned, rate = view.joint("bulb_turn")
    assert (turned < 2.0 * np.pi).all(), "spun by hand, it stops in its thread"
    assert np.abs(rate).max() < 0.01


def test_the_thread_leads_as_stated_under_load() -> None:
    worlds = flown_until(SCREW, screw_bulb.TURN, 150)
    view = worlds.simulation.view
    lead = view.joint("bulb_travel")[0] / view.joint("bulb_turn")[0] * 2.0 * np.pi
    np.testing.assert_allclose(lead, LEAD_M, rtol=0.1)
