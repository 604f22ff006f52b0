"""Worlds with latency: seen and done so many steps late, and their recordings, shifted, are those without it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.latency import Latency
from aerial_il.data.episode import Episode
from aerial_il.data.latency import with_latency
from aerial_il.suite.late import late
from aerial_il.workflows.collect import Collect, collect
from aerial_il.workflows.info import Info, info
from aerial_il.workflows.replay import Replay, replay

CELL = ("floating_gripper", "reach")


def batch() -> aerial_il.suite.batch.BatchEnvironment:
    return aerial_il.load_batch(*CELL, num_envs=2, num_threads=1)


def recorded(out: Path, latency: Latency) -> Episode:
    robot, task = CELL
    kept = {"out": str(out), "threads": 1, "progress": False}
    collect(Collect(robot=robot, task=task, episodes=1, latency=latency, **kept))
    return aerial_il.open_dataset(str(out))[0]


def test_things_are_seen_and_done_late_until_a_reset() -> None:
    now, later = batch(), late(batch(), Latency(observation_delay_ms=40, action_delay_ms=20))
    start = now.reset(0)
    np.testing.assert_array_equal(later.reset(0)["ee_pos"], start["ee_pos"])
    held = later._sent[0].copy()
    sent = [np.clip(held + 0.1 * k, now.spec.action.low, now.spec.action.high) for k in range(1, 7)]
    seen = [start["ee_pos"], *(now.step(action).obs["ee_pos"] for action in (held, *sent))]
    shown = [later.step(action).obs["ee_pos"] for action in sent]
    for step, pos in enumerate(shown, start=1):
        np.testing.assert_array_equal(pos, seen[max(0, step - 2)])
    one = np.array([True, False])
    fresh = later.reset(np.array([7, 7]), one)["ee_pos"]
    np.testing.assert_array_equal(fresh[0], batch().reset(7)["ee_pos"][0])
    np.testing.assert_array_equal(fresh[1], shown[-1][1])


def test_recordings_without_their_latency_are_those_made_without(tmp_path: Path) -> None:
    plain = recorded(tmp_path / "plain", Latency())
    seen_late = recorded(tmp_path / "late", Latency(observation_delay_ms=60))
    assert not np.array_equal(seen_late.obs["ee_pos"], plain.obs["ee_pos"])
    matched = with_latency(seen_late, 0)
    assert len(matched) == len(plain) - 3
    for name, values in plain.obs.items():
        np.testing.assert_array_equal(matched.obs[name], values[:-3])
    np.testing.assert_array_equal(matched.labels, plain.labels[:-3])
    replayed = with_latency(plain, 60)
    np.testing.assert_array_equal(replayed.obs["ee_pos"], seen_late.obs["ee_pos"])
    np.testing.assert_array_equal(replayed.labels, seen_late.labels)
    assert with_latency(plain, 0) is plain
    for beyond in (-1, float("inf")):
        with pytest.raises(InvalidValueError, match=f"latency_ms is {beyond:g}"):
            with_latency(plain, beyond)
    for told in ({"settings": None}, {"settings": {"action_delay_ms": "x"}}, {"drawn": {"latency_steps": None}}):
        with pytest.raises(InvalidValueError, match="tells of its latency cannot be"):
            with_latency(replace(plain, provenance=told), 0)


def test_late_actions_are_known_by_info_replayed_and_matched(tmp_path: Path) -> None:
    episode = recorded(tmp_path / "d", Latency(action_delay_ms=40))
    np.testing.assert_array_equal(episode.executed_actions[2:], episode.spec.action.clip(episode.actions[:-2]))
    matched = with_latency(episode, 0)
    np.testing.assert_array_equal(matched.executed_actions, episode.spec.action.clip(matched.actions))
    np.testing.assert_array_equal(matched.obs["ee_pos"], episode.obs["ee_pos"][2:])
    assert "action_delay_ms=40" in info(Info(path=str(tmp_path / "d")))["episodes"][0]["settings"]
    assert replay(Replay(path=str(tmp_path / "d"), progress=False))


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"action_delay_ms": -20}, "action_delay_ms is -20"),
        ({"observation_delay_ms": 30}, "multiple of the control step, 20 ms: 40 or 20"),
        ({"observation_delay_ms": 5000}, r"must lie in \[0, 1000\]"),
    ],
)
def test_delays_that_cannot_be_are_refused(told: dict[str, float], said: str) -> None:
    with pytest.raises(InvalidValueError, match=said):
        late(batch(), Latency(**told))


def test_no_latency_leaves_worlds_as_they_are() -> None:
    env = batch()
    assert late(env, Latency()) is env


def test_what_is_on_its_way_is_no_part_of_a_state() -> None:
    env = late(batch(), Latency(action_delay_ms=20))
    env.reset(0)
    with pytest.raises(InvalidValueError, match="not in it"):
        env.set_state(env.get_state())
