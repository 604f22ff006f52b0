"""Hindsight beside demonstrations: flights are relabelled, and demonstrations are rewarded by the same rule."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il import algorithms
from aerial_il.algorithms.off_policy.experience_replay import ExperienceReplay
from aerial_il.algorithms.online.demonstrations import read_transitions
from aerial_il.algorithms.online.problem import Given
from aerial_il.algorithms.online.smoothness import NO_SMOOTHNESS
from aerial_il.core.checkpoint import ARRAYS
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms.drift import Drift, demonstrations
from tests.algorithms.made import made, names
from tests.algorithms.sought import NEAR, Sought

NAMES = [n for n in algorithms.names() if {"hindsight.goals", "demonstrations.labels"} <= names(algorithms.get(n))]
each = pytest.mark.parametrize("name", NAMES)
POLICY = SquashedGaussian(hidden=(16,))
SMALL: dict[str, Any] = {"steps": 160, "warmup": 32, "batch_size": 32, "lr": 3e-3, "tau": 0.05, "critic_hidden": (16,)}
SMALL |= {"utd_ratio": 0.2, "actor_every": 1, "gamma": 0.9, "log_every": 80, "checkpoint_every": 0}
SMALL |= {"offline_steps": 10, "critics": 3, "hindsight.goals": 2}


def short(name: str, **changes: Any) -> Any:
    cls: Any = algorithms.get(name)
    return made(cls, {**SMALL, **changes})


def train(settings: Any, run: Path, env: Any, demos: list[Episode] | None = None, **options: Any) -> Any:
    shown = demos or demonstrations(6, ends_at_success=env.ends_at_success)
    return settings.train(shown, POLICY, env=env, run=run, seed=1, progress=False, **options)


def test_those_that_a_prior_leads_have_none_and_the_others_do() -> None:
    assert NAMES == ["awac", "iql", "rlpd"]


@each
def test_flights_are_kept_again_with_goals_that_they_reached(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Of one world, in which each step is kept by itself, and each episode twice when it ends, at success too."""
    kept, keep = [], ExperienceReplay._keep

    def noted(replay: ExperienceReplay, *flown: np.ndarray, **ends: Any) -> None:
        kept.append(flown)
        keep(replay, *flown, **ends)

    monkeypatch.setattr(ExperienceReplay, "_keep", noted)
    train(short(name), tmp_path, Sought(1, ends_at_success=True))
    steps: list[tuple[np.ndarray, ...]] = []
    ended = []
    for frames, actions, rewards, next_frames, lost in kept:
        paid = np.abs(next_frames[:, 0] - next_frames[:, 1]) <= NEAR
        np.testing.assert_array_equal(rewards, paid)
        if len(frames) == 1:
            steps.append((frames, actions, next_frames, lost))
            continue
        own = [np.repeat(np.concatenate(column), 2, axis=0) for column in zip(*steps, strict=True)]
        for again, before in ((frames[:, 0], own[0][:, 0]), (actions, own[1]), (next_frames[:, 0], own[2][:, 0])):
            np.testing.assert_array_equal(again, before)
        np.testing.assert_array_equal(lost, own[3])
        reached = own[2][::2, 0]
        assert all(frames[row, 1] in reached[row // 2 :] for row in range(len(frames))), "from then on"
        assert (rewards[-2:] == 1.0).all(), "the last step reached where it led"
        ended.append("lost" if lost[-1] else "cut" if len(steps) == Sought.spec.max_steps else "solved")
        steps = []
    assert {*ended} >= {"lost", "solved"}, "success is no end of what is to come, a crash is"


@each
def test_demonstrations_are_rewarded_by_the_rule_of_their_goals(name: str) -> None:
    """Whatever they were paid; rough actions cost as before, and success is no end of what is to come."""
    demos, env = demonstrations(6, ends_at_success=True), Sought(8, ends_at_success=True)
    smoothness = replace(NO_SMOOTHNESS, rate_penalty=0.3)
    plain = read_transitions(demos, POLICY, trajectories=None, subsample=1, smoothness=smoothness, seed=0)[1]
    for tolerance in (1.0, 0.5):
        settings = short(name, **{"hindsight.tolerance": tolerance}, smoothness=smoothness)
        found = settings.problem(Given(demos, POLICY, env, 0))
        paid = np.abs(plain.next_frames[:, 0] - plain.next_frames[:, 1]) <= NEAR * tolerance
        np.testing.assert_allclose(found.demos.rewards, paid - plain.penalties)
        assert plain.terminal.sum() == 6
        assert not found.demos.terminal.any()
        assert len(found.demos.encoded(found.interface, absorbing=True, reward=None)) == len(plain.frames)
    assert plain.penalties.any()


@each
def test_stopped_within_episodes_it_ends_with_the_same_bytes(tmp_path: Path, name: str) -> None:
    settings = short(name, evaluate_every=104)
    train(settings, tmp_path / "whole", Sought(8), evaluate=lambda policy, step: {})

    def stop(policy: Any, step: int) -> dict[str, float]:
        if step:
            raise KeyboardInterrupt
        return {}

    with pytest.raises(KeyboardInterrupt):
        train(settings, tmp_path / "run", Sought(8), evaluate=stop)
    train(settings, tmp_path / "run", Sought(8), evaluate=lambda policy, step: {})
    whole, run = ((tmp_path / one / "policy" / ARRAYS).read_bytes() for one in ("whole", "run"))
    assert run == whole


@each
def test_it_is_refused_where_no_goal_is_told(tmp_path: Path, name: str) -> None:
    with pytest.raises(InvalidValueError, match=r"exposes no goal.*hindsight\.goals=0"):
        train(short(name), tmp_path / "run", Drift(8))
    assert not (tmp_path / "run").exists()
