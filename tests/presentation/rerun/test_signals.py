"""Curves and lanes are the recorded numbers, on both timelines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aerial_il.core.specs import ActionSpec
from aerial_il.data.episode import Episode
from aerial_il.evaluation.predictions import Prediction
from aerial_il.presentation.rerun.flight import Flight
from aerial_il.presentation.rerun.signals import groups_of, phase_names
from tests.presentation.rerun.conftest import Shown


def test_actions_rewards_and_observations_are_the_recorded_ones(shown: Shown, episodes: list[Episode]) -> None:
    episode = episodes[0]
    for entity, values in {
        "action/ee_xyz/commanded": episode.actions[:, :3],
        "action/ee_xyz/executed": episode.executed_actions[:, :3],
        "action/gripper/executed": episode.executed_actions[:, 9:],
        "reward": episode.rewards[:, None],
        "observation/joint_pos": episode.obs["joint_pos"],
    }.items():
        found = shown.numbers(f"/signals/{entity}", "Scalars:scalars").reshape(values.shape)
        assert np.array_equal(found, values), entity


def test_both_timelines_are_the_recordings(shown: Shown, episodes: list[Episode]) -> None:
    episode = episodes[0]
    assert np.array_equal(shown.numbers("/scene/robot/base", "step"), np.arange(len(episode) + 1))
    nanoseconds = shown.column("/scene/robot/base", "sim_time").combine_chunks().cast("int64").to_numpy()
    assert nanoseconds * 1e-9 == pytest.approx(episode.sim_time, abs=1e-9)


def test_phases_are_logged_when_they_change(shown: Shown, episodes: list[Episode]) -> None:
    phases = phase_names(episodes[0])
    assert phases is not None
    steps, names = shown.numbers("/states/0_phase", "step"), shown.numbers("/states/0_phase", "StateChange:state")
    assert len(steps) < 12
    spread = [names[np.searchsorted(steps, k, side="right") - 1] for k in range(len(episodes[0]))]
    assert spread == phases.tolist()
    assert shown.numbers("/states/9_outcome", "StateChange:state").tolist() == ["flying", "success"]


def test_flags_stand_after_the_step_that_earned_them(episodes: list[Episode], write: Callable[..., Shown]) -> None:
    episode, flags = episodes[0], np.zeros((len(episodes[0]), 5))
    flags[30:, 1] = 1.0
    shown = write({"": Flight.of(episode, flags)})
    assert shown.numbers("/states/2_grasped", "step").tolist() == [0, 31]
    assert shown.numbers("/states/1_at_cube", "step").tolist() == [0]


def test_a_failure_is_no_success(episodes: list[Episode], write: Callable[..., Shown]) -> None:
    shown = write({"": Flight.of(replace(episodes[0], success=False))})
    assert shown.numbers("/states/9_outcome", "StateChange:state").tolist() == ["flying", "no success"]


def test_chunks_are_drawn_where_they_begin(episodes: list[Episode], write: Callable[..., Shown]) -> None:
    episode, starts = episodes[0], np.arange(0, len(episodes[0]), 10)
    action, times = episode.spec.action, episode.sim_time[:-1]
    predicted = Prediction("p", action.labels, action.units, times, episode.actions, episode.actions + 0.01, starts)
    shown = write({"": Flight.of(episode, prediction=predicted)})
    assert shown.numbers("/scene/predicted", "step").tolist() == starts.tolist()
    first = np.asarray(shown.column("/scene/predicted", "LineStrips3D:strips")[0].as_py())
    assert first.reshape(-1, 3) == pytest.approx(episode.actions[:10, :3] + 0.01, abs=1e-6)
    assert "/signals/action/ee_xyz/predicted" in shown.entities


def test_actions_are_grouped_by_what_they_mean() -> None:
    def names(*labels: str) -> dict[str, tuple[int, ...]]:
        n = len(labels)
        spec = ActionSpec("level", labels, ("",) * n, np.zeros(n), np.ones(n))
        return {group.name: group.columns for group in groups_of(spec)}

    assert names("ee_x", "ee_y", "ee_z", "ee_rot6d_0", "ee_rot6d_1", "gripper") == {
        "ee_xyz": (0, 1, 2), "ee_rot6d": (3, 4), "gripper": (5,),
    }  # fmt: skip
    assert names("0", "1") == {"action": (0, 1)}
    assert names("x") == {"x": (0,)}
