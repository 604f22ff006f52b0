"""A door counts only while it is open, and the expert goes back into the handle when it has lost it."""

from __future__ import annotations

import mujoco
import numpy as np

import aerial_il
from aerial_il.experts.hook import HOVER, PULL
from aerial_il.suite.props.door import DOOR_FRICTION_NM, HINGE_TO_LOOP_M
from aerial_il.suite.scenario import Scenario
from aerial_il.suite.tasks.open_door import OPEN_RAD, OpenDoor
from tests.contract.registered import batch
from tests.suite.dwelling import check_dwell

CELL = ("ua_quad_arm4", "open_door")


def test_success_waits_for_the_dwell_and_ends_when_the_door_is_shut() -> None:
    check_dwell(batch(*CELL), OpenDoor, "door", OPEN_RAD + np.array([0.3, 0.02, -0.02]))


def test_it_takes_the_stated_force_at_the_handle() -> None:
    model = Scenario(*CELL).compile()

    def opened(force: float) -> float:
        data = mujoco.MjData(model)
        data.joint("base").qpos[2], data.mocap_pos[:, 2] = 10.0, 0.4  # out of the way, off the ground
        data.joint("door").qfrc_applied[0] = force * HINGE_TO_LOOP_M
        for _ in range(125):
            mujoco.mj_step(model, data)
        return float(data.joint("door").qpos[0])

    assert opened(0.8 * DOOR_FRICTION_NM / HINGE_TO_LOOP_M) < 0.005, "it hardly creeps"
    assert opened(1.3 * DOOR_FRICTION_NM / HINGE_TO_LOOP_M) > 0.05


def test_the_expert_goes_back_into_the_handle_when_the_door_falls_shut() -> None:
    worlds = batch(*CELL)
    worlds.reset(0)
    expert = aerial_il.expert(*CELL)
    expert.attach(worlds)
    angle, _ = worlds.simulation.view.joint("door")
    while (angle < 0.5 * OPEN_RAD).any():
        worlds.step(expert.act({}))
    assert (expert.phase == PULL).all()
    angle[:] = 0.0
    worlds.set_state(worlds.get_state())
    expert.act({})
    assert (expert.phase == HOVER).all(), "it noticed"
    solved = np.zeros(3, bool)
    while not solved.all() and worlds.simulation.steps.max() < worlds.spec.max_steps:
        solved |= worlds.step(expert.act({}), ~solved).info["success"]
    assert solved.all()
