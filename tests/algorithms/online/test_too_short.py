"""Runs that would end before their policy learns anything are refused, and those one step longer are not."""

from pathlib import Path
from typing import Any

import pytest
import torch

from aerial_il import algorithms
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms.drift import Drift, demonstrations
from tests.algorithms.made import made

POLICY, CHOICES = SquashedGaussian(hidden=(8,)), Categorical(hidden=(8,), choices="bounds")
SMALL: dict[str, Any] = {"warmup": 60, "rollout": 28, "batch_size": 16, "critic_hidden": (8,), "reward_hidden": (8,)}
SMALL |= {"bc_pretrain_steps": 0, "offline_steps": 0, "checkpoint_every": 0, "reward_batch": 16, "epochs": 1}
SMALL |= {"actor_every": 1, "utd_ratio": 1.0, "critics": 3}

# Eight worlds end a warm-up of 60 steps after 64, and a rollout of 28 after 32, two of which end that warm-up. In the
# last turn of dac no learning rate is left, and in no last rollout but those of npg, whose steps do not shrink.
FLOWN = {name: {"warmup": 64} for name in ("sac", "td3", "ddpg", "dqn", "rlpd", "awac", "iql", "ibrl", "sqil")}
FLOWN |= {"dac": {"warmup": 72}, "npg": {}, **{name: {"rollout.steps": 32} for name in ("ppo", "a2c", "reinforce")}}
FLOWN |= {name: {"rollout.steps": 32, "warmup": 64} for name in ("gail", "airl")}
each = pytest.mark.parametrize("name", FLOWN)


def short(name: str, **changes: Any) -> Any:
    return made(algorithms.get(name), {**SMALL, **({"batch_size": None} if name == "a2c" else {}), **changes})


def train(settings: Any, run: Path) -> Any:
    policy = POLICY if isinstance(POLICY, settings.trains) else CHOICES
    return settings.train(demonstrations(4), policy, env=Drift(8), run=run, seed=1, progress=False)


@each
def test_a_run_in_which_nothing_is_learned_is_refused(tmp_path: Path, name: str) -> None:
    for key, flown in FLOWN[name].items():
        value = {"warmup": 60, "rollout.steps": 28}[key]
        message = rf"steps is {flown} and {key} {value}: .* above {flown}, or lower algorithm\.{key}"
        with pytest.raises(InvalidValueError, match=message):
            train(short(name, steps=flown), tmp_path / "run")
    assert not (tmp_path / "run").exists(), "before anything is written"


@each
def test_a_run_that_is_one_step_longer_learns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    before: list[torch.Tensor] = []
    start = OnlineRun.start

    def noted(run: OnlineRun, actor: Any, parts: Any) -> None:
        before.extend(weights.detach().clone() for weights in actor.parameters())
        start(run, actor, parts)

    monkeypatch.setattr(OnlineRun, "start", noted)
    longest = max(FLOWN[name].values(), default=0)
    policy = train(short(name, steps=longest + 1), tmp_path)
    assert any(not torch.equal(*pair) for pair in zip(before, policy.network.parameters(), strict=True))


@pytest.mark.parametrize("name", ["dac", "gail", "airl", "awac", "iql"])
def test_what_has_learned_before_may_fly_for_the_warm_up_alone(tmp_path: Path, name: str) -> None:
    """By cloning, or from a dataset: that shows what it can do. The control without demonstrations clones nothing."""
    before = {"bc_pretrain_steps": 5, "offline_steps": 5, "steps": 16}
    train(short(name, **before), tmp_path / "run")
    if name in ("dac", "gail", "airl"):
        with pytest.raises(InvalidValueError, match="steps is 16"):
            train(short(name, **before, control="constant_reward"), tmp_path / "control")


@pytest.mark.parametrize("name", [name for name, flown in FLOWN.items() if [*flown] == ["warmup"]])
def test_off_policy_learners_need_a_warm_up(name: str) -> None:
    with pytest.raises(InvalidValueError, match="warmup is 0; it must be positive"):
        short(name, warmup=0)
