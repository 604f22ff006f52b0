"""Runs that would end before their policy learns anything are refused, and those one step longer learn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch

from aerial_il import algorithms
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms.drift import Drift, demonstrations
from tests.algorithms.made import made

POLICY = SquashedGaussian(hidden=(8,))
SMALL: dict[str, Any] = {"rollout": 28, "batch_size": 16, "critic_hidden": (8,), "reward_hidden": (8,), "epochs": 1}
SMALL |= {"checkpoint_every": 0, "reward_batch": 16, "bc_pretrain_steps": 0}
ROLLOUT, WARMUP = 32, 64  # what eight worlds fly of 28 steps, and in the rollouts that end a warm-up of 60


def train(name: str, run: Path, **changes: Any) -> Any:
    settings = made(algorithms.get(name), {**SMALL, **changes})
    return settings.train(demonstrations(4), POLICY, env=Drift(8), run=run, seed=1, progress=False)


@pytest.mark.parametrize("name", ["ppo", "a2c", "reinforce", "gail", "airl"])
def test_a_run_of_one_rollout_is_refused(tmp_path: Path, name: str) -> None:
    """For its last rollout no learning rate is left."""
    said = rf"steps is {ROLLOUT} and rollout\.steps 28: .* above {ROLLOUT}, or lower algorithm\.rollout\.steps"
    with pytest.raises(InvalidValueError, match=said):
        train(name, tmp_path / "run", steps=ROLLOUT)
    assert not (tmp_path / "run").exists(), "before anything is written"


@pytest.mark.parametrize("name", ["gail", "airl"])
def test_a_run_of_nothing_but_a_warm_up_is_refused(tmp_path: Path, name: str) -> None:
    said = rf"steps is {WARMUP} and warmup 60: .* above {WARMUP}, or lower algorithm\.warmup"
    with pytest.raises(InvalidValueError, match=said):
        train(name, tmp_path / "run", steps=WARMUP, warmup=60)
    assert not (tmp_path / "run").exists(), "before anything is written"


@pytest.mark.parametrize(
    ("name", "longest", "warmup"),
    [
        *((name, ROLLOUT, 0) for name in ("ppo", "a2c", "reinforce", "gail", "airl")),
        *((name, WARMUP, 60) for name in ("gail", "airl")),
        ("npg", 0, 0),  # whose steps do not shrink
    ],
)
def test_a_run_that_is_one_step_longer_learns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, longest: int, warmup: int
) -> None:
    first: list[torch.Tensor] = []
    begin = OnlineRun.begin

    def noted(run: OnlineRun, actor: Any, parts: Any) -> None:
        first.extend(weights.detach().clone() for weights in actor.parameters())
        begin(run, actor, parts)

    monkeypatch.setattr(OnlineRun, "begin", noted)
    learned = train(name, tmp_path, steps=longest + 1, warmup=warmup).network.parameters()
    assert any(not torch.equal(before, after) for before, after in zip(first, learned, strict=True))


@pytest.mark.parametrize("name", ["gail", "airl"])
def test_what_was_cloned_may_fly_through_its_warm_up_alone(tmp_path: Path, name: str) -> None:
    """A run of nothing but the warm-up shows what the clone can do; the control clones nothing."""
    shown = {"steps": 8, "warmup": 60, "bc_pretrain_steps": 5}
    train(name, tmp_path / "run", **shown)
    with pytest.raises(InvalidValueError, match="the run would end before its policy has learned anything"):
        train(name, tmp_path / "control", **shown, control="constant_reward")
