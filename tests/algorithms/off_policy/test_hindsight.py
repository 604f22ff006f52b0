"""Hindsight, also beside demonstrations: flights are kept again with other goals, paid by the goal's own rule."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il import algorithms
from aerial_il.algorithms.off_policy.experience_replay import ExperienceReplay
from aerial_il.algorithms.off_policy.hindsight import Relabeller
from aerial_il.algorithms.online.collector import Collector
from aerial_il.algorithms.online.demonstrations import read_transitions
from aerial_il.algorithms.online.problem import Given
from aerial_il.algorithms.online.smoothness import NO_SMOOTHNESS
from aerial_il.algorithms.sac import SAC
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.goals import GoalColumns, GoalSpec
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.layout import Layout
from tests.algorithms import small
from tests.algorithms.drift import EDGE, SPEC, Drift, demonstrations
from tests.algorithms.made import names
from tests.algorithms.small import POLICY, short, train
from tests.algorithms.sought import GOAL, NEAR, Hidden, Sought, near
from tests.algorithms.stateless_batch import fly
from tests.algorithms.stopped import assert_same_when_stopped

RELABELLED = [n for n in algorithms.names() if "hindsight.goals" in names(algorithms.get(n))]


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
    *_, last = fly(Hidden(100), policy, 10_000)
    return float(last.info["success"].mean())


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


NAMES = [n for n in algorithms.names() if {"hindsight.goals", "demonstrations.labels"} <= names(algorithms.get(n))]
each = pytest.mark.parametrize("name", NAMES)
BESIDE: dict[str, Any] = {"steps": 160, "warmup": 32, "utd_ratio": 0.2, "offline_steps": 10, "critics": 3}
BESIDE |= {"hindsight.goals": 2}


def beside(name: str, **changes: Any) -> Any:
    return small.short(name, **{**BESIDE, **changes})


def train_beside(settings: Any, run: Path, env: Any, demos: list[Episode] | None = None, **options: Any) -> Any:
    shown = demos or demonstrations(6, ends_at_success=env.ends_at_success)
    return small.train(settings, run, env, shown, **options)


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
    train_beside(beside(name), tmp_path, Sought(1, ends_at_success=True))
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
        settings = beside(name, **{"hindsight.tolerance": tolerance}, smoothness=smoothness)
        found = settings.problem(Given(demos, POLICY, env, 0))
        paid = np.abs(plain.next_frames[:, 0] - plain.next_frames[:, 1]) <= NEAR * tolerance
        np.testing.assert_allclose(found.demos.rewards, paid - plain.penalties)
        assert plain.terminal.sum() == 6
        assert not found.demos.terminal.any()
        assert len(found.demos.encoded(found.interface, absorbing=True, reward=None)) == len(plain.frames)
    assert plain.penalties.any()


@each
def test_stopped_within_episodes_it_ends_with_the_same_bytes(tmp_path: Path, name: str) -> None:
    settings = beside(name, evaluate_every=104)
    assert_same_when_stopped(lambda run, **judged: train_beside(settings, run, Sought(8), **judged), tmp_path, 1)


@each
def test_it_is_refused_where_no_goal_is_told(tmp_path: Path, name: str) -> None:
    with pytest.raises(InvalidValueError, match=r"exposes no goal.*hindsight\.goals=0"):
        train_beside(beside(name), tmp_path / "run", Drift(8))
    assert not (tmp_path / "run").exists()
