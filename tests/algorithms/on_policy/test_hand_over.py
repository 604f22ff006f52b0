"""What is handed over by learners of chunks: what was learned, where it flies no worse than the prior by itself."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from aerial_il.algorithms.on_policy import loop
from aerial_il.algorithms.on_policy.settings import Exploration, Trial
from aerial_il.algorithms.online.collector import Collector
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies import load_policy
from aerial_il.policies.parts.layout import Layout
from tests.algorithms.drift import SPEC, Drift, demonstrations, mean_reward
from tests.algorithms.on_policy.test_from_clone import CLONING, POLICY, each_chunked, train

TRIAL: dict[str, Any] = {"trial": 32, "trial_every": 128}
RUINOUS: dict[str, Any] = {"lr": 1.0, "step_size": 1e4, "demos_weight": 0.0, "gate": 1e9, "target_kl": 0.0}
RUINOUS |= {"schedule": "random", "steps": 2_560}


@pytest.fixture(scope="module")
def prior(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy that plans in every step, as most do."""
    run = tmp_path_factory.mktemp("prior") / "run"
    CLONING.train(demonstrations(40), replace(POLICY, execute=1, ensemble=0.5), run=run, progress=False)
    return run


def flights(policy: Any) -> np.ndarray:
    """What it answers in the first steps of some flights."""
    env, result = Drift(20), []
    obs = env.reset(0)
    policy.reset()
    for _ in range(5):
        result.append(policy.act(obs))
        obs = env.step(result[-1]).obs
    return np.stack(result)


@each_chunked
def test_what_flies_worse_than_the_prior_is_not_handed_over(tmp_path: Path, name: str, prior: Path) -> None:
    """Neither on the way nor in the end; without trials it is."""
    started, judged = load_policy(prior), list[float]()

    def evaluate(policy: Any, step: int) -> dict[str, float]:
        judged.append(mean_reward(policy))
        return {}

    ruined = {**RUINOUS, "prior": str(prior), "evaluate_every": 128, "evaluate": evaluate}
    kept = train(name, tmp_path / "kept", **ruined, **TRIAL)
    np.testing.assert_array_equal(flights(kept), flights(started))
    assert judged == [judged[0]] * len(judged)
    assert len(judged) >= 3
    trials = [row for row in read_metrics(tmp_path / "kept") if "trial/return" in row]
    assert trials
    assert all(row["trial/return"] < row["trial/prior"] for row in trials)
    lost = train(name, tmp_path / "lost", **ruined, trial=0)
    assert mean_reward(lost) < mean_reward(started) - 0.05


def test_that_nothing_was_handed_over_is_said(tmp_path: Path, prior: Path, caplog: pytest.LogCaptureFixture) -> None:
    train("bc_ppo", tmp_path, prior=str(prior), **RUINOUS, **TRIAL)
    assert "the policy of this run is the prior" in caplog.text


def test_what_flies_better_is_handed_over(tmp_path: Path) -> None:
    """From a clone that has learned next to nothing."""
    config, prior = replace(POLICY, execute=1, ensemble=0.5), tmp_path / "prior"
    replace(CLONING, steps=3).train(demonstrations(40), config, run=prior, progress=False)
    policy = train("dapg", tmp_path / "run", prior=str(prior), steps=6_400, **(TRIAL | {"trial_every": 1_000}))
    assert policy.config.execute == 3
    assert mean_reward(policy) > mean_reward(load_policy(prior)) + 0.1
    row = [row for row in read_metrics(tmp_path / "run") if "trial/return" in row][-1]
    assert row["trial/return"] > row["trial/prior"]


def test_a_lent_environment_goes_on_as_if_nothing_had_been_flown() -> None:
    """In the middle of episodes."""
    collectors = [Collector(Drift(4), Layout.of(SPEC, POLICY), seed=0) for _ in range(2)]
    for step in range(20):
        if step == 7:
            with collectors[0].lent() as env:
                env.reset(99)
                env.step(np.ones((4, 1)))
        one, other = (collector.step(np.full((4, 1), 0.1 * (-1) ** step)) for collector in collectors)
        np.testing.assert_array_equal(one.next_frames, other.next_frames)
        np.testing.assert_array_equal(one.truncated, other.truncated)


def test_trials_give_a_slow_prior_its_whole_time(tmp_path: Path, prior: Path) -> None:
    """Episodes of practice are cut after three steps; those of a trial last twelve, and return more."""
    train("bc_ppo", tmp_path, prior=str(prior), patience=0.25, steps=2_560, **TRIAL)
    rows = [row for row in read_metrics(tmp_path) if "trial/return" in row]
    assert max(row["episode/length"] for row in rows) <= 3
    assert rows[0]["trial/prior"] == pytest.approx(12 * mean_reward(load_policy(prior)), rel=0.15)


def test_flights_of_trials_count_as_flown(tmp_path: Path, prior: Path) -> None:
    """A rollout has 128 steps; 32 flights of the prior take up to 12 each, and so do those of the learner."""
    train("bc_ppo", tmp_path, prior=str(prior), steps=1_280, trial=32, trial_every=512)
    steps = [row["step"] for row in read_metrics(tmp_path)]
    rollouts = [after - before for before, after in pairwise(steps)]
    assert 128 in rollouts
    assert 128 + 64 < max(rollouts) <= 128 + 64 * 12


@pytest.mark.parametrize("last", [True, False])
def test_the_last_trial_is_held_whatever_becomes_of_the_last_rollout(
    last: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was learned since the trial before it would be given up unflown."""
    held: list[float] = []
    passes, turns = iter([True, True, last]), iter([1.0, 0.5, 0.0])
    run = SimpleNamespace(collector=SimpleNamespace(n=1), left=1.0, start=lambda *_: None, log=lambda _: None)

    def goes_on() -> bool:
        run.left = next(turns, None)
        return run.left is not None

    run.goes_on, run.end_turn = goes_on, lambda: None
    rollout = SimpleNamespace(rewards=np.zeros((2, 1)), ended=np.zeros((2, 1), bool))
    pilot = SimpleNamespace(flown=9, standardise=lambda: None, collect=lambda _: rollout)
    hand_over = SimpleNamespace(after_learning=lambda: held.append(run.left) or {}, close=lambda: None)
    gate = SimpleNamespace(passes=lambda *_, **__: next(passes))
    agent = SimpleNamespace(learn=lambda *_, **__: {})
    monkeypatch.setattr(loop, "judged", lambda *_: SimpleNamespace(value=0.0))
    settings = SimpleNamespace(gamma=0.9, rollout=SimpleNamespace(steps=2))
    loop.learn_on_policy(run, settings, pilot, agent, None, gate=gate, hand_over=hand_over)  # type: ignore[arg-type]
    assert held == [1.0, 0.5, 0.0]


@pytest.mark.parametrize(("noise", "flights"), [(0.005, 1), (9.0, 1), (0.1, 10**6), (0.1, -1)])
def test_noise_that_would_not_be_flown_and_endless_trials_are_refused(noise: float, flights: int) -> None:
    with pytest.raises(InvalidValueError, match=r"noise is .*\(0.0067, 7.4\)|flights is .* in \[0, 100000\]"):
        Exploration(execute=1, noise=noise, correlation=0.0), Trial(flights=flights, every=1)
