"""Runs that would end before their policy learns anything are refused, and those one step longer are not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from aerial_il.algorithms.decisions.practice import PractisedPolicy

from aerial_il import algorithms
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.rl.algorithm import OnlineAlgorithm
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms.drift import Drift, demonstrations

ONLINE = {n: s for n in algorithms.names() if issubclass(s := algorithms.get(n), OnlineAlgorithm)}
NAMES = [n for n, s in ONLINE.items() if not issubclass(s, PractisedPolicy)]
each = pytest.mark.parametrize("name", NAMES)
POLICY, CHOICES = SquashedGaussian(hidden=(8,)), Categorical(hidden=(8,), choices="bounds")
SMALL: dict[str, Any] = {"warmup": 60, "rollout": 28, "batch_size": 16, "critic_hidden": (8,), "reward_hidden": (8,)}
SMALL |= {"bc_pretrain_steps": 0, "offline_steps": 0, "checkpoint_every": 0, "reward_batch": 16, "epochs": 1}
SMALL |= {"actor_every": 1, "utd_ratio": 1.0, "critics": 3}


def short(name: str, **changes: Any) -> Any:
    cls: Any = ONLINE[name]
    return cls(**{k: v for k, v in {**SMALL, **changes}.items() if k in cls.__dataclass_fields__})


def train(settings: Any, run: Path) -> Any:
    policy = POLICY if isinstance(POLICY, settings.trains) else CHOICES
    return settings.train(demonstrations(4), policy, env=Drift(8), run=run, seed=1, progress=False)


@each
def test_a_run_in_which_nothing_is_learned_is_refused(tmp_path: Path, name: str) -> None:
    """Eight worlds end a warm-up of 60 steps after 64, and a rollout of 28 after 32; two of these end that warm-up."""
    for key, flown in short(name).flown_before_learning(8).items():
        assert flown == {"warmup": 64, "rollout": 32}[key] + 8 * (name == "dac"), "whose last turn has no learning rate"
        said = rf"steps is {flown} and {key} {SMALL[key]}: .* above {flown}, or lower algorithm\.{key}"
        with pytest.raises(InvalidValueError, match=said):
            train(short(name, steps=flown), tmp_path / "run")
    assert not (tmp_path / "run").exists(), "before anything is written"


@each
def test_a_run_that_is_one_step_longer_learns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    begun: list[torch.Tensor] = []
    begin = OnlineRun.begin

    def noted(run: OnlineRun, actor: Any, parts: Any) -> None:
        begun.extend(weights.detach().clone() for weights in actor.parameters())
        begin(run, actor, parts)

    monkeypatch.setattr(OnlineRun, "begin", noted)
    longest = max(short(name).flown_before_learning(8).values(), default=0)
    policy = train(short(name, steps=longest + 1), tmp_path)
    learned = policy.network.parameters()
    assert any(not torch.equal(first, last) for first, last in zip(begun, learned, strict=True))


def test_more_than_the_warm_up_is_not_needed_where_something_was_learned_before() -> None:
    """By cloning, or from a dataset: a run of nothing but the warm-up shows what that can do."""
    for name in ("dac", "gail", "airl"):
        assert short(name, bc_pretrain_steps=5).flown_before_learning(8) == {}
        assert short(name, bc_pretrain_steps=5, control="constant_reward").flown_before_learning(8), "clones nothing"
    for name in ("awac", "iql"):
        assert short(name, offline_steps=5).flown_before_learning(8) == {}
    assert short("npg").flown_before_learning(8) == {}, "whose steps do not shrink"
