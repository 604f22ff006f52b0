"""Experts that look: what comes next is brought ahead, the task is still done, and nobody else flies otherwise."""

from contextlib import closing

import numpy as np
import pytest

import aerial_il
from aerial_il.core.errors import InvalidValueError
from aerial_il.experts.expert import pointing_down
from aerial_il.experts.gaze import AHEAD_RAD, ARRIVING_M, turned_to_see


class View:
    """Three robots that hover over the origin, their tools below them."""

    base_pos = np.array([[0.0, 0.0, 1.0]] * 3)
    tool_pos = np.array([[0.0, 0.0, 0.6]] * 3)


def heading(rot6d: np.ndarray) -> np.ndarray:
    return np.arctan2(-rot6d[:, 3], rot6d[:, 4])


def turned(target: np.ndarray, yaw: np.ndarray, travels: bool = True) -> np.ndarray:
    return turned_to_see(View(), target, pointing_down(yaw), np.full(3, travels))  # pyright: ignore[reportArgumentType]


def test_it_turns_as_far_as_it_must_and_the_tool_still_points_down() -> None:
    bearing = np.array([2.0, -3.0, 0.3])
    target = np.stack([np.cos(bearing), np.sin(bearing), np.zeros(3)], axis=1)
    rot6d = turned(target, np.zeros(3))
    np.testing.assert_allclose(heading(rot6d), [2.0 - AHEAD_RAD, -3.0 + AHEAD_RAD, 0.0], atol=1e-12)
    np.testing.assert_allclose(rot6d[:, :3], [[0.0, 0.0, -1.0]] * 3, atol=1e-12)


def test_where_it_arrives_and_where_the_heading_counts_it_is_the_experts_own() -> None:
    behind, yaw = np.array([[-ARRIVING_M, 0.0, 0.0]] * 3), np.array([0.1, 0.2, 0.3])
    np.testing.assert_array_equal(turned(behind, yaw), pointing_down(yaw))
    np.testing.assert_array_equal(turned(8 * behind, yaw, travels=False), pointing_down(yaw))
    assert (turned(8 * behind, yaw) != pointing_down(yaw)).any()


@pytest.mark.parametrize("task", ["reach", "pick_place"])
def test_it_does_its_task_otherwise_than_one_that_does_not_look(task: str) -> None:
    flown = []
    for options in ({}, {"look": False}, {"look": True}):
        with closing(aerial_il.load_batch("fa_hexa_arm4", task, num_envs=2)) as env:
            expert = aerial_il.expert("fa_hexa_arm4", task, **options)
            expert.attach(env)
            obs, solved, tools = env.reset(np.array([5000, 5001])), np.zeros(2, bool), []
            for _ in range(env.spec.max_steps):
                result = env.step(expert.act(obs))
                obs, solved = result.obs, solved | result.info["success"]
                tools.append(obs["ee_pos"])
                if solved.all():
                    break
            assert solved.all()
            flown.append(np.array(tools))
    np.testing.assert_array_equal(flown[0], flown[1])
    assert len(flown[2]) > len(flown[0]), "slower near what it handles"


def test_an_expert_whose_heading_is_never_free_says_so() -> None:
    with pytest.raises(InvalidValueError, match=r"look=true.*RestockExpert.*travels"):
        aerial_il.expert("fa_hexa_arm4", "restock", look=True)
