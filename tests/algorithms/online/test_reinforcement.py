"""Learning from a reward as it comes: ends, standardised observations, what rough actions cost."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from aerial_il import algorithms
from aerial_il.algorithms.dqn import DQN
from aerial_il.algorithms.online.collector import Collector, RewardScheme
from aerial_il.algorithms.online.interface import check_policy, encode, plain_interface, standardised
from aerial_il.algorithms.online.moments import RunningMoments
from aerial_il.algorithms.online.smoothness import NO_SMOOTHNESS
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.contracts import StepResult
from aerial_il.core.errors import InvalidValueError, NoRewardError
from aerial_il.policies import load_policy
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.parts.layout import Layout
from tests.algorithms.drift import SPEC, Drift, Silent
from tests.algorithms.made import names
from tests.algorithms.small import CHOICES, POLICY, short, train
from tests.algorithms.stopped import assert_same_when_stopped

TAUGHT = {n: algorithms.get(n) for n in algorithms.names()}
REWARDED = [n for n, s in TAUGHT.items() if getattr(s, "rewarded", False) and not s.demonstrated]


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
    assert_same_when_stopped(lambda run, **judged: train(settings, run, Drift(8), **judged), tmp_path, 160)


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


def test_rough_actions_cost_what_the_settings_say() -> None:
    smoothness = replace(NO_SMOOTHNESS, rate_penalty=2.0, jerk_penalty=3.0)
    collector = Collector(Drift(1), Layout.of(SPEC, POLICY), seed=0, scheme=RewardScheme(smoothness=smoothness))
    actions = [-0.5, 1.0, 1.0, -0.5]  # from -1 to 1: -1, 1, 1, -1
    costs = [collector.step(np.array([[action]])).penalties[0] for action in actions]
    assert costs == pytest.approx([0.0, 2.0 * 4.0, 0.0, 2.0 * 4.0 + 3.0 * 0.0 + 3.0 * (-1.0 - 3.0 + 3.0 + 1.0) ** 2])
    collector.step(np.array([[1.0]]))
    assert collector.step(np.array([[-0.5]])).penalties[0] == pytest.approx(8.0 + 3.0 * (-1 - 3 * 1 + 3 * -1 - 1) ** 2)


def test_a_new_episode_owes_nothing_to_the_one_before() -> None:
    scheme = RewardScheme(smoothness=replace(NO_SMOOTHNESS, rate_penalty=1.0))
    collector = Collector(Drift(1), Layout.of(SPEC, POLICY), seed=0, scheme=scheme)
    while not collector.step(np.array([[1.0]])).terminal[0]:
        pass
    assert collector.step(np.array([[-0.5]])).penalties[0] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ppo", "sac", "td3", "ddpg"])
def test_caps_makes_actors_that_answer_alike_to_what_follows(tmp_path: Path, name: str) -> None:
    """Beside the same training without: the same seeds, the same flights at first."""
    steps = 4_000 if name == "ppo" else 800
    rough, smooth = (
        train(
            short(name, steps=steps, smoothness=replace(NO_SMOOTHNESS, temporal=w, spatial=w)),
            tmp_path / str(w),
            Drift(8),
        )
        for w in (0.0, 30.0)
    )
    assert roughness(smooth) < 0.5 * roughness(rough)


def roughness(policy: Any) -> float:
    env = Drift(64)
    obs, actions = env.reset(7), []
    policy.reset()
    for _ in range(5):
        actions.append(policy.act(obs))
        obs = env.step(actions[-1]).obs
    return float(np.abs(np.diff(actions, axis=0)).mean())


def test_an_actor_of_choices_cannot_be_regularised() -> None:
    network = CHOICES.build(2, 1)
    with pytest.raises(InvalidValueError, match=r"temporal is 1 .*rate_penalty"):
        replace(NO_SMOOTHNESS, temporal=1.0).loss(network, torch.zeros(3, 2), torch.zeros(3, 2))
    for asked in ("temporal", "spatial"):
        with pytest.raises(InvalidValueError, match=rf"{asked}( is)? 0\.5.*rate_penalty"):
            DQN(smoothness=replace(NO_SMOOTHNESS, **{asked: 0.5}))
    DQN(smoothness=replace(NO_SMOOTHNESS, rate_penalty=0.5))
