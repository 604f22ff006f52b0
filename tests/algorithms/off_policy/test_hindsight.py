"""Hindsight: episodes are kept again with other goals, and where that cannot be."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il import algorithms
from aerial_il.algorithms.off_policy.hindsight import Relabeller
from aerial_il.algorithms.online.collector import Collector
from aerial_il.algorithms.sac import SAC
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.goals import GoalColumns, GoalSpec
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms.drift import EDGE, MAX_STEPS, SPEC, Drift
from tests.algorithms.made import made, names
from tests.algorithms.sought import GOAL, Hidden, Sought, near

POLICY = SquashedGaussian(hidden=(16,))
RELABELLED = [n for n in algorithms.names() if "hindsight.goals" in names(algorithms.get(n))]
SMALL: dict[str, Any] = {"warmup": 64, "batch_size": 32, "lr": 3e-3, "tau": 0.05, "critic_hidden": (16,)}
SMALL |= {"utd_ratio": 0.5, "actor_every": 1, "target_every": 1, "gamma": 0.9, "epochs": 4, "rollout": 80}
SMALL |= {"log_every": 80, "checkpoint_every": 0}


def short(name: str, **changes: Any) -> Any:
    cls: Any = algorithms.get(name)
    return made(cls, {**SMALL, **changes})


def train(settings: Any, run: Path, env: Any, **options: Any) -> Any:
    return settings.train(None, POLICY, env=env, run=run, seed=1, progress=False, **options)


def flown(strategy: str, goals: int) -> tuple[np.ndarray, ...]:
    """Return an episode of one world that never moves on purpose, as it is remembered once more."""
    env = Sought(1)
    columns = GoalColumns(GOAL, {"position": slice(0, 1), "goal": slice(1, 2)})
    settings = replace(SAC.hindsight, goals=goals, strategy=strategy)  # type: ignore[arg-type]
    relabeller = Relabeller(settings, columns, 1, np.random.default_rng(0))
    collector = Collector(env, Layout.of(SPEC, POLICY), seed=3)
    rng = np.random.default_rng(1)
    while True:
        actions = rng.uniform(-0.5, 0.5, (1, 1))
        if found := relabeller.add(collector.step(actions), actions):
            return found[0]


@pytest.mark.parametrize(("strategy", "goals"), [("future", 4), ("final", 1)])
def test_an_episode_is_kept_again_with_goals_that_it_reached(strategy: str, goals: int) -> None:
    frames, actions, rewards, next_frames, lost = flown(strategy, goals)
    steps = len(frames) // goals
    np.testing.assert_array_equal(frames[:, 1], next_frames[:, 1])
    reached_later = next_frames[::goals, 0]
    for row in range(len(frames)):
        step = row // goals
        later = reached_later[step:] if strategy == "future" else reached_later[-1:]
        assert frames[row, 1] in later, "a goal that was reached from then on"
        assert rewards[row] == float(abs(next_frames[row, 0] - frames[row, 1]) <= 0.2)
    assert (rewards[-goals:] == 1.0).all(), "the last step reached where it led"
    assert not lost.any() or np.abs(reached_later[-1]) > EDGE
    assert len(actions) == steps * goals


def test_a_narrower_tolerance_pays_for_less() -> None:
    columns = GoalColumns(GOAL, {"position": slice(0, 1), "goal": slice(1, 2)})
    frames = np.array([[0.05, 0.0], [0.15, 0.0], [0.25, 0.0]])
    np.testing.assert_array_equal(columns.rewards(frames), [1, 1, 0])
    np.testing.assert_array_equal(columns.rewards(frames, tolerance=0.5), [1, 0, 0])
    paid = []
    for tolerance in (1.0, 0.5):
        relabeller = Relabeller(
            replace(SAC.hindsight, goals=1, tolerance=tolerance), columns, 1, np.random.default_rng(0)
        )
        collector, rewards = Collector(Sought(1), Layout.of(SPEC, POLICY), seed=3), 0.0
        rng = np.random.default_rng(1)
        for _ in range(60):
            actions = rng.uniform(-0.5, 0.5, (1, 1))
            step = collector.step(actions)
            rewards += float(relabeller.rewards(step).sum())
            rewards += sum(float(again[2].sum()) for again in relabeller.add(step, actions))
        paid.append(rewards)
    assert paid[0] > paid[1] > 0, "flights for their own goals and again for others"
    with pytest.raises(InvalidValueError, match="tolerance"):
        replace(SAC.hindsight, tolerance=1.5)
    own = GoalColumns(GoalSpec(("position",), ("goal",), near), {"position": slice(0, 1), "goal": slice(1, 2)})
    with pytest.raises(InvalidValueError, match=r"The rule of this goal is its own: tolerance is 0\.5"):
        own.rewards(frames, tolerance=0.5)


def test_offsets_follow_the_goal_that_is_put_in() -> None:
    spec = GoalSpec(("ee",), ("target",), lambda a, d: np.zeros(len(a)), offsets={"to_target": ("target", "ee")})
    columns = GoalColumns(spec, {"ee": slice(0, 2), "target": slice(2, 4), "to_target": slice(4, 6)})
    frames = np.array([[1.0, 2.0, 5.0, 5.0, 4.0, 3.0]])
    changed = columns.exchanged(frames, np.array([[1.5, 2.0]]))
    np.testing.assert_array_equal(changed, [[1.0, 2.0, 1.5, 2.0, 0.5, 0.0]])
    np.testing.assert_array_equal(frames[0, 2:4], [5.0, 5.0])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sac"])
def test_hindsight_learns_where_the_reward_hardly_comes(tmp_path: Path, name: str) -> None:
    """Beside the same training without, which finds nothing: success of the final policy."""
    rates = []
    for goals in (0, 4):
        settings = short(name, steps=2_400, batch_size=64, critic_hidden=(32, 32), **{"hindsight.goals": goals})
        rates.append(success_rate(train(settings, tmp_path / f"{goals}", Hidden(8))))
    assert rates[0] < 0.1
    assert rates[1] > 0.7


def success_rate(policy: Any) -> float:
    env = Hidden(100)
    obs, done = env.reset(10_000), np.zeros(100, bool)
    policy.reset()
    for _ in range(MAX_STEPS):
        result = env.step(policy.act(obs))
        obs, done = result.obs, result.info["success"]
    return float(done.mean())


def test_hindsight_is_refused_where_no_goal_is_told_or_seen(tmp_path: Path) -> None:
    settings = short("td3", steps=80, **{"hindsight.goals": 4})
    with pytest.raises(InvalidValueError, match="exposes no goal"):
        train(settings, tmp_path / "none", Drift(8))
    unseeing = replace(POLICY, obs_names=("position",))
    with pytest.raises(InvalidValueError, match="goal is not shown"):
        settings.train(None, unseeing, env=Sought(8), run=tmp_path / "unseeing", progress=False)
    with pytest.raises(InvalidValueError, match="one final goal"):
        replace(SAC.hindsight, goals=4, strategy="final")


@pytest.mark.parametrize("name", RELABELLED)
def test_with_hindsight_another_reward_is_refused(name: str) -> None:
    with pytest.raises(InvalidValueError, match=r"goals is 4 and reward sparse.*reward=environment.*goals=0"):
        short(name, reward="sparse", **{"hindsight.goals": 4})
    short(name, reward="sparse", **{"hindsight.goals": 0})
