"""Doors, valves, levers and sliders count only while they are held, resist as stated, and are met again when lost."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il.experts.expert import Expert
from aerial_il.experts.hook import HOVER, PULL
from aerial_il.experts.pull_lever import behind_bar
from aerial_il.experts.push_slider import CLEAR_M, OVER
from aerial_il.suite import tasks
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.physics.view import View
from aerial_il.suite.props.door import DOOR_FRICTION_NM
from aerial_il.suite.props.slider import FRICTION_N, RAIL_M
from aerial_il.suite.props.valve import VALVE_FRICTION_NM, VALVE_OPEN_RAD
from aerial_il.suite.scenario import Scenario
from aerial_il.suite.tasks import pull_lever, rotate_valve
from aerial_il.suite.tasks.open_door import OPEN_RAD
from aerial_il.suite.tasks.pull_lever import PULLED_RAD
from aerial_il.suite.tasks.push_slider import DONE_SHARE
from tests.contract.registered import batch, fly_until_solved, hold_actions

ROBOT = "ua_quad_arm4"
SOLVED, JUST, NOT = 0.2, 0.02, -0.02  # rad from where a hinge begins to count
HINGED = np.array([SOLVED, JUST, NOT])


def put(worlds: BatchEnvironment, joint: str, values: np.ndarray | float) -> None:
    """Set a joint of every world, rad or m."""
    worlds.simulation.view.joint(joint)[0][:] = values
    worlds.set_state(worlds.get_state())


def started(task: str) -> tuple[BatchEnvironment, Expert]:
    """Worlds at the start of their episodes, and an expert attached to them."""
    worlds, expert = batch(ROBOT, task), aerial_il.expert(ROBOT, task)
    worlds.reset(0)
    expert.attach(worlds)
    return worlds, expert


@pytest.mark.parametrize(
    ("task", "joint", "values"),
    [
        ("open_door", "door", OPEN_RAD + HINGED),
        ("rotate_valve", "valve", VALVE_OPEN_RAD + HINGED),
        ("push_slider", "slider", RAIL_M * np.array([0.99, DONE_SHARE + 0.01, DONE_SHARE - 0.01])),
    ],
)
def test_success_waits_for_the_dwell_and_ends_with_it(task: str, joint: str, values: np.ndarray) -> None:
    worlds, _ = started(task)
    hover = hold_actions(worlds)
    put(worlds, joint, values)
    dwell = round(tasks.get(task).dwell_s / worlds.spec.control_dt_s)
    seen = [worlds.step(hover).info["success"] for _ in range(dwell)]
    assert not np.any(seen[:-1])
    assert seen[-1].tolist() == [True, True, False]
    put(worlds, joint, 0.0)
    assert not worlds.step(hover).info["success"].any()


@pytest.mark.parametrize(
    ("task", "joint", "friction", "weak", "strong"),
    [
        ("open_door", "door", DOOR_FRICTION_NM, (0.8, 0.005), (1.3, 0.05)),
        ("rotate_valve", "valve", VALVE_FRICTION_NM, (0.8, 0.005), (1.2, 0.1)),
        ("push_slider", "slider", FRICTION_N, (0.7, 0.002), (1.3, 0.02)),
    ],
)
def test_it_resists_with_its_stated_friction(
    task: str, joint: str, friction: float, weak: tuple[float, float], strong: tuple[float, float]
) -> None:
    model = Scenario(ROBOT, task).compile()

    def moved(share: float) -> float:
        data = mujoco.MjData(model)
        data.joint("base").qpos[2], data.mocap_pos[:, 2] = 10.0, 0.4  # out of the way, off the ground
        data.joint(joint).qfrc_applied[0] = share * friction
        for _ in range(125):
            mujoco.mj_step(model, data)
        return float(data.joint(joint).qpos[0])

    assert abs(moved(weak[0])) < weak[1], "it hardly creeps"
    assert moved(strong[0]) > strong[1]


def anyhow(view: View) -> np.ndarray:
    return np.ones(view.n)


def over_bar(view: View) -> np.ndarray:
    return (view.tip_pos - behind_bar(view))[:, 2]


def over_slider(view: View) -> np.ndarray:
    return (view.tip_pos - view.site_pos("slider"))[:, 2]


@pytest.mark.parametrize(
    ("task", "joint", "moved", "phase", "height", "least"),
    [
        ("open_door", "door", 0.5 * OPEN_RAD, HOVER, anyhow, 0.0),
        ("pull_lever", "lever", 0.7 * PULLED_RAD, HOVER, over_bar, 0.03),
        (
            "push_slider",
            "slider",
            0.6 * RAIL_M,
            OVER,
            over_slider,
            CLEAR_M - 0.03,
        ),
    ],
)
def test_the_expert_goes_back_over_what_it_has_lost(
    task: str, joint: str, moved: float, phase: int, height: Callable[[View], np.ndarray], least: float
) -> None:
    worlds, expert = started(task)
    view, highest = worlds.simulation.view, np.full(3, -1.0)
    while (view.joint(joint)[0] < moved).any():
        worlds.step(expert.act({}))
    put(worlds, joint, 0.0)  # it springs back through the fingers: now they are on its other side
    expert.act({})
    assert (expert.phase == phase).all(), "it noticed"
    assert fly_until_solved(worlds, expert, lambda: np.maximum(highest, height(view), out=highest)).all()
    assert (highest > least).all(), "over it, not through it"


def test_a_lever_is_held_by_friction_or_taken_back_by_its_spring() -> None:
    worlds, _ = started("pull_lever")
    (low, high), angle = pull_lever.START_ANGLE_RAD, worlds.simulation.view.joint("lever")[0]
    hover, start = hold_actions(worlds), np.array([low, high, PULLED_RAD + 0.05])
    put(worlds, "lever", start)
    assert PULLED_RAD - high >= np.deg2rad(44.99)
    for _ in range(round(pull_lever.PullLever.dwell_s / worlds.spec.control_dt_s)):
        assert not worlds.step(hover).info["success"].any(), "let go, it does not stay"
    assert (np.abs(angle - start)[:2] < 0.01).all()
    assert angle[2] < PULLED_RAD - 0.1


def test_success_is_lost_with_the_lever() -> None:
    worlds, expert = started("pull_lever")
    success = np.zeros(3, bool)
    while not success.all():
        success = worlds.step(expert.act({})).info["success"]
    put(worlds, "lever", 0.0)
    result = worlds.step(expert.act({}))
    assert not result.info["success"].any()
    assert (result.reward < 0.5).all()


def test_a_valve_is_half_a_turn_from_open_at_any_start() -> None:
    worlds = batch(ROBOT, "rotate_valve", num_envs=16)
    worlds.reset(0)
    angle, _ = worlds.simulation.view.joint("valve")
    assert VALVE_OPEN_RAD - rotate_valve.START_ANGLE_RAD[1] >= np.pi
    assert (VALVE_OPEN_RAD - angle >= np.pi).all()
    assert np.ptp(angle) > 0.3


def test_another_expert_tows_a_valve_on_and_goes_back_in() -> None:
    worlds, first = started("rotate_valve")
    second = aerial_il.expert(ROBOT, "rotate_valve")
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
    assert fly_until_solved(worlds, second).all()
