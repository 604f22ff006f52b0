"""A valve counts only while it is open, resists as stated, and is towed on from wherever the fingers are."""

from __future__ import annotations

import mujoco
import numpy as np

import aerial_il
from aerial_il.experts.hook import HOVER, PULL
from aerial_il.suite.props.valve import VALVE_FRICTION_NM, VALVE_OPEN_RAD
from aerial_il.suite.scenario import Scenario
from aerial_il.suite.tasks.rotate_valve import START_ANGLE_RAD, RotateValve
from tests.contract.registered import batch
from tests.suite.dwelling import check_dwell

CELL = ("ua_quad_arm4", "rotate_valve")


def test_it_is_half_a_turn_from_any_start() -> None:
    worlds = batch(*CELL, num_envs=16)
    worlds.reset(0)
    angle, _ = worlds.simulation.view.joint("valve")
    assert VALVE_OPEN_RAD - START_ANGLE_RAD[1] >= np.pi
    assert (VALVE_OPEN_RAD - angle >= np.pi).all()
    assert np.ptp(angle) > 0.3


def test_success_waits_for_the_dwell_and_ends_when_the_valve_is_closed_again() -> None:
    check_dwell(batch(*CELL), RotateValve, "valve", VALVE_OPEN_RAD + np.array([0.2, 0.02, -0.02]))


def test_the_spindle_resists_with_its_stated_friction() -> None:
    model = Scenario(*CELL).compile()

    def turned(torque: float) -> float:
        data = mujoco.MjData(model)
        data.joint("base").qpos[2], data.mocap_pos[:, 2] = 10.0, 0.4  # out of the way, off the ground
        data.joint("valve").qpos[0] = 1.0
        data.joint("valve").qfrc_applied[0] = torque
        for _ in range(125):
            mujoco.mj_step(model, data)
        return float(data.joint("valve").qpos[0]) - 1.0

    assert abs(turned(0.8 * VALVE_FRICTION_NM)) < 0.005, "it hardly creeps"
    assert turned(1.2 * VALVE_FRICTION_NM) > 0.1


def test_another_expert_tows_on_and_goes_back_in_when_lifted_out() -> None:
    worlds = batch(*CELL)
    worlds.reset(0)
    first, second = aerial_il.expert(*CELL), aerial_il.expert(*CELL)
    first.attach(worlds)
    second.attach(worlds)
    angle, _ = worlds.simulation.view.joint("valve")
    while (angle < 0.5 * VALVE_OPEN_RAD).any():
        worlds.step(first.act({}))
    second.act({})
    assert (second.phase == PULL).all(), "the fingers are between the spokes already"
    up = first.act({})
    for _ in range(50):
        up[:, :3] = worlds.observe()["ee_pos"] + [0.0, 0.0, 0.08]
        worlds.step(up)
    second.act({})
    assert (second.phase == HOVER).all(), "it noticed"
    solved = np.zeros(3, bool)
    while not solved.all() and worlds.simulation.steps.max() < worlds.spec.max_steps:
        solved |= worlds.step(second.act({}), ~solved).info["success"]
    assert solved.all()
