"""A slider counts only while it is at the end, and the expert gets behind the handle from wherever it is."""

from __future__ import annotations

import numpy as np

import aerial_il
from aerial_il.experts.push_slider import CLEAR_M, OVER
from aerial_il.suite.props.slider import FRICTION_N, RAIL_M
from aerial_il.suite.tasks.push_slider import DONE_SHARE, PushSlider
from tests.contract.registered import batch

CELL = ("ua_quad_arm4", "push_slider")


def test_success_waits_for_the_dwell_and_ends_when_the_slider_is_taken_back() -> None:
    worlds = batch(*CELL)
    obs = worlds.reset(0)
    travel, _ = worlds.simulation.view.joint("slider")
    hover = np.concatenate([obs["ee_pos"], obs["ee_rot6d"], np.ones((3, 1))], axis=1)
    dwell = round(PushSlider.dwell_s / worlds.spec.control_dt_s)

    travel[:] = [0.99 * RAIL_M, (DONE_SHARE + 0.01) * RAIL_M, (DONE_SHARE - 0.01) * RAIL_M]
    worlds.set_state(worlds.get_state())
    seen = [worlds.step(hover).info["success"] for _ in range(dwell)]
    assert not np.any(seen[:-1])
    assert seen[-1].tolist() == [True, True, False]

    travel[:] = 0.0
    worlds.set_state(worlds.get_state())
    assert not worlds.step(hover).info["success"].any()


def test_the_expert_goes_around_a_handle_that_it_has_passed() -> None:
    worlds = batch(*CELL)
    worlds.reset(0)
    expert = aerial_il.expert(*CELL)
    expert.attach(worlds)
    view, travel = worlds.simulation.view, worlds.simulation.view.joint("slider")[0]
    while (travel < 0.6 * RAIL_M).any():
        worlds.step(expert.act({}))
    travel[:] = 0.0  # the handle springs back: now the gripper is on its other side
    worlds.set_state(worlds.get_state())
    expert.act({})
    assert (expert.phase == OVER).all()
    solved, highest = np.zeros(3, bool), np.full(3, -1.0)
    for _ in range(500):
        solved |= worlds.step(expert.act({}), ~solved).info["success"]
        highest = np.maximum(highest, view.tip_pos[:, 2] - view.site_pos("slider")[:, 2])
    assert solved.all()
    assert (highest > CLEAR_M - 0.03).all()


def test_the_rail_resists_with_its_stated_friction() -> None:
    worlds = batch(*CELL)
    obs = worlds.reset(0)
    hover = np.concatenate([obs["ee_pos"], obs["ee_rot6d"], np.ones((3, 1))], axis=1)
    view = worlds.simulation.view
    travel, along = view.joint("slider")[0], view.site_mat("slider")[:, [0, 3, 6]]
    pull = worlds.simulation.worlds.bind("xfrc_applied")[:, worlds.model.body("slider").id, :3]
    before = travel.copy()
    pull[:] = FRICTION_N * np.array([[0.7], [1.3], [0.0]]) * along
    for _ in range(25):
        worlds.step(hover)
    pull[:] = 0.0
    moved = travel - before
    assert (np.abs(moved[[0, 2]]) < 0.002).all(), "it hardly creeps"
    assert moved[1] > 0.02
