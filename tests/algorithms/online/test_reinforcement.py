"""What learners from a reward share: time limits, standardisation, a reward that never comes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from aerial_il import algorithms
from aerial_il.algorithms.online.collector import Collector, RewardScheme
from aerial_il.algorithms.online.interface import check_policy, encode, plain_interface, standardised
from aerial_il.algorithms.online.moments import RunningMoments
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.contracts import StepResult
from aerial_il.core.errors import InvalidValueError, NoRewardError
from aerial_il.policies import load_policy
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms.drift import SPEC, Drift, Silent
from tests.algorithms.made import made, names

TAUGHT = {n: algorithms.get(n) for n in algorithms.names()}
REWARDED = [n for n, s in TAUGHT.items() if getattr(s, "rewarded", False) and not s.demonstrated]
POLICY = SquashedGaussian(hidden=(16,))
CHOICES = Categorical(hidden=(16,), choices="bounds")
SMALL: dict[str, Any] = {"warmup": 64, "batch_size": 32, "lr": 3e-3, "tau": 0.05, "critic_hidden": (16,)}
SMALL |= {"utd_ratio": 0.5, "actor_every": 1, "target_every": 1, "gamma": 0.9, "epochs": 4, "rollout": 80}
SMALL |= {"log_every": 80, "checkpoint_every": 0}


def short(name: str, **changes: Any) -> Any:
    cls: Any = algorithms.get(name)
    return made(cls, {**SMALL, **changes})


def policy_of(settings: Any) -> Any:
    return POLICY if isinstance(POLICY, settings.trains) else CHOICES


def train(settings: Any, run: Path, env: Any, **options: Any) -> Any:
    return settings.train(None, policy_of(settings), env=env, run=run, seed=1, progress=False, **options)


class Paid(Drift):
    """Pays 1 for a step, and ends with it as it is told to."""

    terminal = False

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        result = super().step(0.0 * actions, mask)
        over = self.steps >= 1
        terminated, truncated = (over, ~over) if self.terminal else (~over, over)
        return replace(result, reward=np.ones(self.num_envs), terminated=terminated, truncated=truncated)


class Ends(Paid):
    terminal = True


@pytest.mark.parametrize("name", REWARDED)
def test_a_time_limit_is_no_end_of_what_is_to_come(tmp_path: Path, name: str) -> None:
    """One step of 1 is worth 1, steps without end 10 at gamma 0.9: only who goes on in the estimate tells the two."""
    entropy = {"alpha": 1e-6, "entropy": -20.0} if name == "sac" else {}
    often = {"rollout": 16, "lr": 1e-2, "steps": 800} if "rollout.steps" in names(algorithms.get(name)) else {}
    settings = short(name, **({"steps": 400} | entropy | often))
    values = {}
    for env in (Paid(8), Ends(8)):
        train(settings, tmp_path / type(env).__name__, env)
        values[type(env)] = read_metrics(tmp_path / type(env).__name__)[-1]["critic/value"]
    assert values[Paid] > 1.3 * values[Ends] > 0


@pytest.mark.parametrize("name", REWARDED)
def test_what_standardises_observations_is_saved(tmp_path: Path, name: str) -> None:
    policy = train(short(name, steps=320, obs_norm=True), tmp_path, Drift(8))
    again = load_policy(tmp_path)
    assert (policy.interface.obs.scale != 1.0).all()
    np.testing.assert_array_equal(again.interface.obs.centre, policy.interface.obs.centre)
    obs = Drift(8).reset(0)
    np.testing.assert_array_equal(again.act(obs), policy.act(obs))


def test_what_the_warm_up_kept_is_standardised_when_it_ends(tmp_path: Path) -> None:
    """Stopped after the warm-up and gone on with, the run ends with the same bytes: the moments are kept too."""
    settings = short("td3", steps=320, obs_norm=True, evaluate_every=160)
    whole = train(settings, tmp_path / "whole", Drift(8), evaluate=lambda policy, step: {})

    def stop(policy: Any, step: int) -> dict[str, float]:
        if step >= 160:
            raise KeyboardInterrupt
        return {}

    with pytest.raises(KeyboardInterrupt):
        train(settings, tmp_path / "run", Drift(8), evaluate=stop)
    again = train(settings, tmp_path / "run", Drift(8), evaluate=lambda policy, step: {})
    for mine, theirs in zip(again.network.parameters(), whole.network.parameters(), strict=True):
        assert torch.equal(mine, theirs)


@pytest.mark.parametrize("name", REWARDED)
def test_a_reward_that_never_comes_is_reported(tmp_path: Path, name: str) -> None:
    settings = short(name, steps=480, reward_patience=160)
    with pytest.raises(NoRewardError, match=r"no reward but 0 has come.*reward_patience"):
        train(settings, tmp_path / "run", Silent(8))
    train(replace(settings, reward_patience=0), tmp_path / "run", Silent(8))
    assert read_metrics(tmp_path / "run")[-1]["step"] == 480


def test_a_constant_reward_informs_where_episodes_end_early(tmp_path: Path) -> None:
    """As in CartPole: each step is paid alike, and an episode that lives longer is paid more."""

    class Alive(Drift):
        def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
            return replace(super().step(actions, mask), reward=np.ones(self.num_envs))

    train(short("ddpg", steps=480, reward_patience=160), tmp_path, Alive(8))


def test_sparse_pays_success_alone() -> None:
    env = Drift(4)
    collector = Collector(env, Layout.of(SPEC, POLICY), seed=0, scheme=RewardScheme(sparse=True))
    steps = [collector.step(np.zeros((4, 1))) for _ in range(30)]
    assert {float(r) for step in steps for r in step.rewards} == {0.0, 1.0}
    assert all((step.rewards == step.success).all() for step in steps)


def test_choices_are_refused_where_actions_are_none() -> None:
    with pytest.raises(InvalidValueError, match="choices=bounds"):
        plain_interface(Layout.of(SPEC, CHOICES), Categorical())
    with pytest.raises(InvalidValueError, match="choose policy=categorical"):
        check_policy(POLICY, (Categorical,))


def test_only_standardised_observations_are_clipped() -> None:
    interface = plain_interface(Layout(SPEC, ("position", "goal")), POLICY)
    far = np.array([[25.0, -300.0]])
    np.testing.assert_array_equal(encode(interface, far), far)
    moments = RunningMoments(2)
    moments.add(np.random.default_rng(0).normal(size=(100, 2)))
    np.testing.assert_allclose(encode(standardised(interface, moments), far), [[10.0, -10.0]])


@pytest.mark.parametrize("name", ["ppo", "sac"])
def test_a_short_run_without_reward_says_so_at_its_end(
    tmp_path: Path, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    train(short(name, steps=160), tmp_path / "run", Silent(8))
    assert "In all 160 environment steps no reward but 0 has come: the policy has learned nothing." in caplog.text
    assert "algorithm=bc_ppo dataset=PATH" in caplog.text
    assert ("algorithm.hindsight.goals=4" in caplog.text) == (name == "sac"), "which has it"
    caplog.clear()
    train(short(name, steps=160), tmp_path / "rewarded", Drift(8))
    train(short(name, steps=160, reward_patience=0), tmp_path / "unasked", Silent(8))
    assert not caplog.text


def test_success_in_the_last_step_is_an_end() -> None:
    class Arriving(Drift):
        def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
            result, yes = super().step(actions, mask), np.ones(self.num_envs, bool)
            return replace(result, truncated=yes, info={**result.info, "success": yes})

    for ends in (True, False):
        collector = Collector(Arriving(4, ends_at_success=ends), Layout(SPEC, ("position", "goal")), seed=0)
        step = collector.step(np.zeros((4, 1)))
        assert (step.terminal == ends).all()
        assert (step.truncated != ends).all()
