"""Learners that go on from a clone: what they begin with, what they keep, what guides them, and what is refused."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il import algorithms
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.jsrl import JSRL
from aerial_il.algorithms.on_policy.from_clone import FromClone
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.errors import InvalidValueError, NoRewardError
from aerial_il.policies import load_policy
from aerial_il.policies.flow import Flow
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.parts.residual import ResidualPolicy
from tests.algorithms.drift import SPEC, Drift, Guide, Silent, demonstrations, mean_reward
from tests.algorithms.made import made
from tests.algorithms.stopped import assert_same_when_stopped, bytes_of

NAMES = [n for n in algorithms.names() if issubclass(algorithms.get(n), FromClone)]
CHUNKED = [n for n in NAMES if hasattr(algorithms.get(n), "exploration")]
each, each_chunked = pytest.mark.parametrize("name", NAMES), pytest.mark.parametrize("name", CHUNKED)
PLAIN: dict[str, Any] = {"anchor": None, "masked_fields": ()}
POLICY = MLP(hidden=(16,), chunk=3, history=2, execute=3, ensemble=None, **PLAIN)
CLONING = BC(steps=200, batch_size=64, lr=3e-3, warmup_steps=10, ema=0.9, validation=0.0)
SMALL: dict[str, Any] = {"steps": 640, "warmup": 128, "rollout": 128, "batch_size": 16, "lr": 1e-3, "gamma": 0.9}
SMALL |= {"critic_hidden": (16,), "hidden": (16,), "execute": 3, "hold": 2, "log_every": 128, "epochs": 2}
SMALL |= {"checkpoint_every": 128, "cloning": CLONING, "window": 10, "reward": "environment", "trial": 0}


def train(
    name: str, run: Path, *, env: Any = None, demos: Any = None, policy: PolicySettings = POLICY, **changes: Any
) -> Any:
    cls: Any = algorithms.get(name)
    kept = {"evaluate": changes.pop("evaluate", None), "expert": changes.pop("expert", Guide())}
    settings = made(cls, {**SMALL, **changes})
    return settings.train(
        demos or demonstrations(10), policy, env=env or Drift(8), run=run, seed=1, progress=False, **kept
    )


@pytest.fixture(scope="module")
def prior(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("prior") / "run"
    CLONING.train(demonstrations(40), POLICY, run=run, progress=False)
    return run


@each
def test_through_the_warm_up_the_prior_stays_and_a_critic_learns(tmp_path: Path, name: str, prior: Path) -> None:
    policy = train(name, tmp_path, prior=str(prior), steps=128, schedule="random")
    alone, obs = load_policy(prior), Drift(20).reset(0)
    np.testing.assert_array_equal(policy.act(obs), alone.act(obs))
    assert "critic/loss" in read_metrics(tmp_path)[0]


@each
def test_what_it_learned_is_saved_and_flies_on(tmp_path: Path, name: str, prior: Path) -> None:
    policy = train(name, tmp_path, prior=str(prior), schedule="random")
    again, alone, env = load_policy(tmp_path), load_policy(prior), Drift(20)
    policy.reset()
    obs, differs = env.reset(0), False
    for _ in range(7):
        actions = policy.act(obs)
        np.testing.assert_array_equal(again.act(obs), actions)
        differs |= not np.array_equal(actions, alone.act(obs))
        obs = env.step(actions).obs
    assert differs


@each
def test_stopped_anywhere_it_ends_with_the_same_bytes(tmp_path: Path, name: str, prior: Path) -> None:
    """Twice, in the middle of episodes, chunks and what a guide flies."""
    settings = {"prior": str(prior), "evaluate_every": 128, "trial": 8, "trial_every": 128, "steps": 960}
    assert_same_when_stopped(partial(train, name, **settings), tmp_path, 256, 512)


@each
def test_the_prior_is_judged_before_anything_is_learned(tmp_path: Path, name: str) -> None:
    """As it flies by itself, with overlapping chunks; from that the report tells the largest dip."""
    config, prior = replace(POLICY, execute=1, ensemble=0.5), tmp_path / "prior"
    CLONING.train(demonstrations(5), config, run=prior, progress=False)
    flown, chunked = mean_reward(load_policy(prior)), load_policy(prior)
    chunked = ChunkPolicy(POLICY, chunked.interface, chunked.network)
    assert mean_reward(chunked) != pytest.approx(flown, rel=1e-4), "otherwise nothing is tested"
    train(name, tmp_path, prior=str(prior), evaluate=lambda policy, step: {"success": mean_reward(policy)})
    first = read_metrics(tmp_path)[0]
    assert (first["step"], first["evaluate/success"]) == (0, pytest.approx(flown))


def test_dropout_is_for_cloning(tmp_path: Path) -> None:
    """A network is set to evaluation wherever a checkpoint is taken; nothing may depend on when that is."""
    dropping, runs = replace(POLICY, dropout=0.2), []
    for cadence in (128, 0):
        train("bc_ppo", tmp_path / str(cadence), policy=dropping, checkpoint_every=cadence)
        runs.append(bytes_of(tmp_path / str(cadence)))
    assert runs[0] == runs[1]


def test_a_training_too_short_to_learn_anything_says_so(
    tmp_path: Path, prior: Path, caplog: pytest.LogCaptureFixture
) -> None:
    train("bc_ppo", tmp_path / "long", prior=str(prior), steps=257, warmup=128)
    assert "next to nothing" not in caplog.text
    train("bc_ppo", tmp_path / "short", prior=str(prior), steps=256, warmup=128)
    assert "algorithm.steps=256" in caplog.text
    assert "more than 256 steps" in caplog.text


# -- what is refused


@each
def test_a_prior_that_acts_or_sees_otherwise_is_refused(tmp_path: Path, name: str, prior: Path) -> None:
    seen, others = SPEC.observation.fields[0], SPEC.observation.fields[1:]
    shown = replace(SPEC, observation=replace(SPEC.observation, fields=(replace(seen, unit="km"), *others)))
    turned = replace(SPEC, action=replace(SPEC.action, level="thrust"))
    for spec, word in ((shown, "observation"), (turned, "action")):
        env = Drift(8)
        env.spec = spec
        with pytest.raises(InvalidValueError, match=rf"cannot fly here.*{word}.*prior=RUN"):
            train(name, tmp_path / word, prior=str(prior), env=env)
        assert not (tmp_path / word).exists()


@each
def test_demonstrations_longer_than_episodes_are_refused(tmp_path: Path, name: str) -> None:
    env = Drift(8)
    env.spec = replace(SPEC, max_steps=5)
    with pytest.raises(InvalidValueError, match=r"takes 12 steps, and episodes end after 5.*horizon=12"):
        train(name, tmp_path / "run", env=env)


@each
def test_a_sparse_reward_that_never_comes_is_said(tmp_path: Path, name: str, prior: Path) -> None:
    with pytest.raises(NoRewardError, match="reward_patience"):
        train(name, tmp_path, env=Silent(8), prior=str(prior), reward="sparse", reward_patience=256)


@each
def test_demonstrations_need_no_rewards(tmp_path: Path, name: str, prior: Path) -> None:
    unpaid = [replace(d, rewards=0.0 * d.rewards) for d in demonstrations(4)]
    train(name, tmp_path, demos=unpaid, prior=str(prior), steps=128)


@each_chunked
def test_chunks_that_a_network_draws_by_itself_are_refused(tmp_path: Path, name: str) -> None:
    drawing = Flow(width=16, blocks=1, chunk=3, execute=3, ensemble=None, **PLAIN)
    with pytest.raises(InvalidValueError, match=r"policy=flow.*noise of its own.*algorithm=residual"):
        train(name, tmp_path, policy=drawing, cloning=replace(CLONING, steps=2))


def test_a_residual_shifts_a_prior_of_any_class(tmp_path: Path) -> None:
    drawing = Flow(width=16, blocks=1, chunk=3, execute=1, ensemble=0.1, **PLAIN)
    policy = train("residual", tmp_path, policy=drawing, cloning=replace(CLONING, steps=20))
    assert isinstance(policy, ResidualPolicy)
    assert policy.base.config == drawing


# -- jump start


def test_the_guide_leaves_as_the_learner_manages(tmp_path: Path, prior: Path) -> None:
    train("jsrl", tmp_path, prior=str(prior), steps=2_560, stages=3, horizon=9, tolerance=0.5)
    steps = [row["guide/steps"] for row in read_metrics(tmp_path)]
    assert steps[0] == 9
    assert steps == sorted(steps, reverse=True)
    assert steps[-1] == 0


class Still(Guide):
    """Never arrives."""

    def act(self, obs: Any) -> np.ndarray:
        return np.zeros_like(obs["position"])


def test_a_guide_whose_flights_never_succeed_does_not_leave(tmp_path: Path, prior: Path) -> None:
    """Nothing is no better than nothing: a window without any success passes no stage."""
    sparse = {"prior": str(prior), "steps": 1_280, "stages": 3, "horizon": 12, "reward": "sparse"}
    train("jsrl", tmp_path, env=Silent(8), expert=Still(), reward_patience=0, **sparse)
    assert {row["guide/steps"] for row in read_metrics(tmp_path)} == {12}


def test_what_the_guide_earns_is_not_the_learners(tmp_path: Path, prior: Path) -> None:
    """It flies whole episodes, and succeeds; the learner never flies, and never hears of a success."""
    guided = {"prior": str(prior), "horizon": 12, "window": 10_000, "reward": "sparse"}
    with pytest.raises(NoRewardError):
        train("jsrl", tmp_path, env=Drift(8, ends_at_success=True), reward_patience=256, **guided)


def test_another_policy_can_guide(tmp_path: Path, prior: Path) -> None:
    train("jsrl", tmp_path / "run", guide=str(prior), prior=str(prior), expert=None, schedule="random", steps=128)
    with pytest.raises(InvalidValueError, match=r"no expert for go on mass.*guide=RUN"):
        train("jsrl", tmp_path / "none", prior=str(prior), expert=None)


def test_a_guide_that_flies_longer_than_episodes_is_refused(tmp_path: Path, prior: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"would fly 13 steps .*cut after 12.*algorithm.patience"):
        train("jsrl", tmp_path, prior=str(prior), horizon=13)


def test_a_guide_that_flies_until_practice_is_cut_is_refused(tmp_path: Path, prior: Path) -> None:
    """By default it flies as long as the longest demonstration, 12 steps."""
    with pytest.raises(InvalidValueError, match=r"would fly 12 steps .*cut after 6: .*algorithm.patience than 0.5"):
        train("jsrl", tmp_path, prior=str(prior), patience=0.5)


def test_steps_of_the_guide_do_not_count_as_the_learners_warm_up(tmp_path: Path, prior: Path) -> None:
    """It flies ten of every twelve steps."""
    guided = {"prior": str(prior), "horizon": 10, "window": 10_000, "warmup": 100}
    alone, obs = load_policy(prior), Drift(20).reset(0)
    early, late = (train("jsrl", tmp_path / str(steps), steps=steps, **guided) for steps in (512, 1_280))
    np.testing.assert_array_equal(early.act(obs), alone.act(obs))
    assert not np.array_equal(late.fresh().act(obs), alone.fresh().act(obs))


def test_a_guide_from_elsewhere_is_called_a_guide(prior: Path) -> None:
    spec = replace(SPEC, action=replace(SPEC.action, level="force"))
    with pytest.raises(InvalidValueError, match=r"The guide .*cannot fly here.*algorithm.guide=RUN"):
        JSRL(guide=str(prior)).inputs(spec, None, demonstrations(2))
