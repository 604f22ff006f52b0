"""A lever counts only while it is held, its spring takes it back, and the expert gets behind it from wherever it is."""

from __future__ import annotations

import numpy as np

import aerial_il
from aerial_il.experts.hook import HOVER, PULL
from aerial_il.experts.pull_lever import behind_bar
from aerial_il.suite.tasks.pull_lever import PULLED_RAD, START_ANGLE_RAD, PullLever
from tests.contract.registered import batch

CELL = ("ua_quad_arm4", "pull_lever")


def test_friction_holds_it_at_the_start_and_the_spring_takes_it_back_from_the_end() -> None:
    worlds = batch(*CELL)
    obs = worlds.reset(0)
    angle, _ = worlds.simulation.view.joint("lever")
    hover = np.concatenate([obs["ee_pos"], obs["ee_rot6d"], np.ones((3, 1))], axis=1)
    angle[:] = start = np.array([START_ANGLE_RAD[0], START_ANGLE_RAD[1], PULLED_RAD + 0.05])
    worlds.set_state(worlds.get_state())
    assert PULLED_RAD - START_ANGLE_RAD[1] >= np.deg2rad(44.99)
    for _ in range(round(PullLever.dwell_s / worlds.spec.control_dt_s)):
        assert not worlds.step(hover).info["success"].any(), "let go, it does not stay"
    assert (np.abs(angle - start)[:2] < 0.01).all()
    assert angle[2] < PULLED_RAD - 0.1


def test_success_is_lost_with_the_lever() -> None:
    worlds = batch(*CELL)
    worlds.reset(0)
    expert = aerial_il.expert(*CELL)
    expert.attach(worlds)
    success = np.zeros(3, bool)
    while not success.all():
        success = worlds.step(expert.act({})).info["success"]
    angle, _ = worlds.simulation.view.joint("lever")
    angle[:] = 0.0
    worlds.set_state(worlds.get_state())
    result = worlds.step(expert.act({}))
    assert not result.info["success"].any()
    assert (result.reward < 0.5).all()


def test_the_expert_goes_round_a_bar_that_it_has_passed() -> None:
    worlds = batch(*CELL)
    worlds.reset(0)
    expert, view = aerial_il.expert(*CELL), worlds.simulation.view
    expert.attach(worlds)
    expert.act({})
    while (expert.phase != PULL).any():
        worlds.step(expert.act({}))
    angle, _ = view.joint("lever")
    while (angle < 0.7 * PULLED_RAD).any():
        worlds.step(expert.act({}))
    angle[:] = 0.0  # the lever springs back through the fingers: now they are in front of it
    worlds.set_state(worlds.get_state())
    expert.act({})
    assert (expert.phase == HOVER).all()
    solved, highest = np.zeros(3, bool), np.full(3, -1.0)
    while not solved.all() and worlds.simulation.steps.max() < worlds.spec.max_steps:
        solved |= worlds.step(expert.act({}), ~solved).info["success"]
        highest = np.maximum(highest, (view.tip_pos - behind_bar(view))[:, 2])
    assert solved.all()
    assert (highest > 0.03).all(), "over the bar, not through it"
