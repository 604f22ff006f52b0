"""Peg and button: play of a millimetre, rest on the table, pressed only while pressed, and never hard."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il.experts import insert_peg
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.episode.simulation import STATE_OFFSET
from aerial_il.suite.physics import episode_state
from aerial_il.suite.props import TABLE_HEIGHT_M
from aerial_il.suite.props.button import CAP_HEIGHT_M, FULL_FORCE_N, PRELOAD_N, TRAVEL_M
from aerial_il.suite.props.peg import FLOOR_M, PEG_LENGTH_M, PEG_RADIUS_M
from aerial_il.suite.props.place import place
from aerial_il.suite.tasks.press_button import BY_TOOL, PEAK_FORCE_N
from tests.contract.registered import batch, fly_until_solved, hold_actions

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
    peak = mujoco.mj_stateSize(worlds.model, STATE_OFFSET) + episode_state.FORCES.start + 3 * episode_state.MAX_FORCES
    states[1, peak] = PEAK_FORCE_N + 0.1
    obs = worlds.set_state(states)
    assert obs["peak_force"][1, 0] > PEAK_FORCE_N
    assert press(worlds, 200).any(axis=0).tolist() == [True, False, True]


def sink_onto_the_button(worlds: BatchEnvironment, part: str, steps: int = 40) -> np.ndarray:
    """Let the robot of every world, its arm stretched out ahead, sink onto an upright button below ``part`` of it.

    Returns:
        (steps, n) true force on the button at the end of each step, N.
    """
    view, model = worlds.simulation.view, worlds.model
    view.joint_pos[:] = view.robot.rest_forward
    worlds.set_state(worlds.get_state())
    for i in range(worlds.num_envs):
        data = worlds.simulation.worlds.data(i)
        middle = 0.5 * (data.geom(part).xpos + data.body(part).xpos)  # of the half that is farther from the gripper
        underside = middle - [0.0, 0.0, model.geom(part).size[0]]
        place(view, i, "button", underside - [0.0, 0.0, CAP_HEIGHT_M + 0.004])
        place(view, i, "button_stand", underside - [0.0, 0.0, 0.2])
    worlds.set_state(worlds.get_state())
    action, felt = hold_actions(worlds), []
    for _ in range(steps):
        action[:, 2] -= 0.0005
        worlds.step(action)
        felt.append([true_force(worlds, i) for i in range(worlds.num_envs)])
    return np.array(felt)


def true_force(worlds: BatchEnvironment, world: int) -> float:
    """Net force of all contacts with the button in one world, N, from the solver's contacts without any sensor."""
    own = worlds.simulation.worlds
    model, data, total = own.model, copy.copy(own.data(world)), np.zeros(3)
    mujoco.mj_forward(model, data)
    button = {model.geom(name).id for name in ("button_cap", "button_housing")}
    for k in range(data.ncon):
        first, second = data.contact.geom[k]
        if {first, second} & button:
            wrench = np.empty(6)
            mujoco.mj_contactForce(model, data, k, wrench)
            total += (1.0 if second in button else -1.0) * data.contact.frame[k].reshape(3, 3).T @ wrench[:3]
    return float(np.linalg.norm(total))


@pytest.mark.parametrize("part", ["link_2", "link_3"])
def test_a_link_on_the_button_is_felt_and_does_not_count(part: str) -> None:
    worlds = batch(*CELL)
    worlds.reset(0)
    felt = sink_onto_the_button(worlds, part)
    view = worlds.simulation.view
    by_link_alone = view.peak_force(BY_TOOL) == 0.0
    assert by_link_alone.any()
    assert (felt.max(axis=0) > 2.0).all(), "it does press"
    assert (view.peak_force() >= 0.8 * felt.max(axis=0)).all(), "and the judge feels it, whoever it is"
    assert (worlds.simulation.reassess().contacts[by_link_alone] > 0.0).all()
    assert not worlds.simulation.reassess().success[by_link_alone].any()


def test_the_spring_pushes_back_as_stated() -> None:
    model = batch(*CELL).model
    joint = model.joint("button")
    force = [float(joint.stiffness[0] * (q - model.qpos_spring[joint.qposadr[0]])) for q in (0.0, TRAVEL_M)]
    np.testing.assert_allclose(force, [PRELOAD_N, FULL_FORCE_N], rtol=1e-5)
