"""Two cubes and one bowl: nothing that is seen says which cube is meant, and only the right one counts."""

from __future__ import annotations

import numpy as np
import pytest

from aerial_il import experts
from aerial_il.core.contracts import attach, begin_episodes
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.props import TABLE_HEIGHT_M
from tests.contract.registered import batch, hold_actions

ROBOT = "fa_hexa_arm4"
TASKS = ("place_orange", "place_green")


def put(worlds: BatchEnvironment, cube: str, off: tuple[float, float, float], world: int) -> None:
    view = worlds.simulation.view
    pose, speed = view.free_joint(f"{cube}_cube")
    view.qpos[world, pose] = [*(view.site_pos("bowl")[world] + off), 1.0, 0.0, 0.0, 0.0]
    view.qvel[world, speed] = 0.0
    worlds.set_state(worlds.get_state())


def test_what_is_seen_is_the_same_in_both() -> None:
    one, other = (batch(ROBOT, task).spec for task in TASKS)
    assert one.observation == other.observation
    assert one.instruction != other.instruction
    orange, green = (batch(ROBOT, task) for task in TASKS)
    orange.reset(3)
    seen = green.set_state(orange.get_state())
    for name, values in orange.observe().items():
        np.testing.assert_array_equal(values, seen[name], err_msg=name)


@pytest.mark.parametrize("task", TASKS)
def test_the_wrong_cube_let_go_of_in_the_bowl_ends_it(task: str) -> None:
    worlds, right = batch(ROBOT, task), task.removeprefix("place_")
    wrong = {"orange": "green", "green": "orange"}[right]
    worlds.reset(0)
    put(worlds, wrong, (0.0, 0.0, 0.0285), 0)
    put(worlds, right, (0.0, 0.0, 0.0285), 1)
    stay, won, lost = hold_actions(worlds), np.zeros(3, bool), np.zeros(3, bool)
    for _ in range(40):
        result = worlds.step(stay)
        won, lost = won | result.info["success"], lost | result.info["dropped"]
    assert won.tolist() == [False, True, False]
    assert lost.tolist() == [True, False, False]


def test_both_cubes_in_the_bowl_are_no_success() -> None:
    worlds = batch(ROBOT, "place_orange")
    worlds.reset(0)
    for cube, height in (("orange", 0.0285), ("green", 0.0285 + 0.041)):
        put(worlds, cube, (0.0, 0.0, height), 0)
    put(worlds, "orange", (0.12, 0.0, 0.0285), 1)
    stay = hold_actions(worlds)
    assert not any(worlds.step(stay).info["success"][:2].any() for _ in range(40))
    assert (worlds.simulation.view.site_pos("bowl")[:, 2] == TABLE_HEIGHT_M).all()


def test_the_expert_of_one_fails_the_other() -> None:
    """Done exactly, the wrong task is no success: the expert for orange flies worlds in which green is meant."""
    worlds = batch(ROBOT, "place_green")
    pilot = experts.make(ROBOT, "place_orange")
    attach(pilot, worlds)
    obs = worlds.reset(10)
    begin_episodes(pilot, np.arange(10, 13))
    won, lost = np.zeros(3, bool), np.zeros(3, bool)
    for _ in range(600):
        result = worlds.step(pilot.act(obs))
        obs, won, lost = result.obs, won | result.info["success"], lost | result.info["dropped"]
    assert not won.any()
    assert lost.all()
