"""A pressed button counts only while it is pressed, and only if nothing was ever pushed hard."""

from __future__ import annotations

import mujoco
import numpy as np

import aerial_il
from aerial_il.suite import memory
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.props.button import FULL_FORCE_N, PRELOAD_N, TRAVEL_M
from aerial_il.suite.simulation import STATE_OFFSET
from aerial_il.suite.tasks.press_button import PEAK_FORCE_N
from tests.contract.registered import batch

CELL = ("ua_quad_arm4", "press_button")


def press(worlds: BatchEnvironment, steps: int) -> np.ndarray:
    """Let the expert fly all worlds on, whether they have succeeded or not; return success at every step."""
    expert = aerial_il.expert(*CELL)
    expert.attach(worlds)
    return np.array([worlds.step(expert.act({})).info["success"] for _ in range(steps)])


def test_success_ends_when_the_button_is_let_go() -> None:
    worlds = batch(*CELL)
    obs = worlds.reset(0)
    start = np.concatenate([obs["ee_pos"], obs["ee_rot6d"], np.zeros((3, 1))], axis=1)
    assert press(worlds, 200).any(axis=0).all()
    for _ in range(100):
        result = worlds.step(start)
    assert not result.info["success"].any()
    assert (result.obs["button_travel"] < 0.001).all(), "the spring has pushed the cap out"


def test_one_hard_blow_spoils_the_episode() -> None:
    worlds = batch(*CELL)
    worlds.reset(0)
    states = worlds.get_state()
    peak = mujoco.mj_stateSize(worlds.model, STATE_OFFSET) + memory.FORCES.start + 3 * memory.MAX_FORCES
    states[1, peak] = PEAK_FORCE_N + 0.1
    obs = worlds.set_state(states)
    assert obs["peak_force"][1, 0] > PEAK_FORCE_N
    assert press(worlds, 200).any(axis=0).tolist() == [True, False, True]


def test_the_spring_pushes_back_as_stated() -> None:
    model = batch(*CELL).model
    joint = model.joint("button")
    force = [float(joint.stiffness[0] * (q - model.qpos_spring[joint.qposadr[0]])) for q in (0.0, TRAVEL_M)]
    np.testing.assert_allclose(force, [PRELOAD_N, FULL_FORCE_N], rtol=1e-5)
