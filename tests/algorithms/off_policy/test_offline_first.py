"""Learners from a dataset first: the offline part is counted, saved and judged, and only what is better is imitated."""

import os
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from aerial_il.algorithms.iql import IQL, ImplicitAgent
from aerial_il.algorithms.online.replay_buffer import Batch, ReplayBuffer, mixed
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from tests.algorithms import small
from tests.algorithms.drift import Drift, demonstrations, mean_reward
from tests.algorithms.made import made
from tests.algorithms.small import POLICY
from tests.algorithms.stopped import bytes_of

NAMES = ["awac", "iql"]
each = pytest.mark.parametrize("name", NAMES)
BRIEF = {"steps": 80, "warmup": 16, "log_every": 20, "checkpoint_every": 20, "offline_steps": 50}


def train(name: str, run: Path, demos: list[Episode] | None = None, evaluate: Any = None, **changes: Any) -> Any:
    settings = small.short(name, **{**BRIEF, **changes})
    return small.train(settings, run, Drift(8), demos or demonstrations(6), evaluate=evaluate)


@each
def test_offline_steps_are_counted_up_to_zero(tmp_path: Path, name: str) -> None:
    train(name, tmp_path, evaluate=lambda policy, step: {"at": float(step)})
    rows = read_metrics(tmp_path)
    assert [row["step"] for row in rows if "critic/loss" in row][:3] == [-30, -10, 0]
    assert [row["evaluate/at"] for row in rows if "evaluate/at" in row] == [0.0, 80.0]
    steps = [row["step"] for row in rows]
    assert steps == sorted(steps)


@each
def test_stopped_before_it_flies_it_ends_with_the_same_bytes(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the middle of the offline part, and again while the policy that is to fly is judged."""
    train(name, tmp_path / "whole", evaluate=lambda policy, step: {})
    honest, drawn = ReplayBuffer.sample, []

    def interrupted(self: ReplayBuffer, count: int) -> Batch:
        drawn.append(count)
        if len(drawn) == 33:
            os.kill(os.getpid(), signal.SIGINT)
        return honest(self, count)

    def judged(policy: Any, step: int) -> dict[str, float]:
        os.kill(os.getpid(), signal.SIGINT)
        return {}

    monkeypatch.setattr(ReplayBuffer, "sample", interrupted)
    with pytest.raises(KeyboardInterrupt):
        train(name, tmp_path / "run")
    assert len(drawn) == 33, "it stopped at once, not at the end of the offline part"
    monkeypatch.setattr(ReplayBuffer, "sample", honest)
    with pytest.raises(KeyboardInterrupt):
        train(name, tmp_path / "run", evaluate=judged)
    train(name, tmp_path / "run", evaluate=lambda policy, step: {})
    assert bytes_of(tmp_path / "run") == bytes_of(tmp_path / "whole")


def paid(episodes: list[Episode], reward: float, action: float) -> list[Episode]:
    """Return episodes in which one action was taken and paid throughout."""
    fixed = {"rewards": reward, "executed_actions": action}
    return [replace(e, **{k: np.full_like(getattr(e, k), v) for k, v in fixed.items()}) for e in episodes]


@each
def test_what_was_paid_more_is_imitated(tmp_path: Path, name: str) -> None:
    """The same places, one action paid and another not; the second was taken in failed flights."""
    good, bad = paid(demonstrations(6), 1.0, 0.8), paid(demonstrations(6), 0.0, -0.3)
    both = [*good, *(replace(e, success=False, uid=f"failed-{e.uid}") for e in bad)]
    settings = {"offline_steps": 300, "steps": 8, "warmup": 8}
    taken = {}
    for failures in (False, True):
        run = tmp_path / str(failures)
        taken[failures] = train(name, run, both, failures=failures, **settings).act(Drift(20).reset(0)).mean()
    assert taken[False] == pytest.approx(0.8, abs=0.15), "all that it has seen"
    assert taken[True] == pytest.approx(0.8, abs=0.25), "of what it has seen, what was paid"
    plain = train("awac", tmp_path / "plain", both, failures=True, temperature=1e9, **settings)
    assert plain.act(Drift(20).reset(0)).mean() < 0.6, "cloning, which cannot tell them apart"


@pytest.mark.slow
@each
def test_flights_make_it_better_than_the_dataset_did(tmp_path: Path, name: str) -> None:
    """The dataset: 72 steps of random flights, of which nothing can be learned but what they reached."""
    few = {"offline_steps": 300, "control": "random_actions", "warmup": 80, "checkpoint_every": 0}
    offline = train(name, tmp_path / "offline", steps=8, **few)
    online = train(name, tmp_path / "online", steps=4_000, **few)
    assert mean_reward(online) > mean_reward(offline) + 0.05


def batch(size: int = 16) -> Batch:
    torch.manual_seed(0)
    obs = torch.cat([torch.randn(size, 2), torch.zeros(size, 1)], 1)
    return Batch(obs, torch.rand(size, 1) * 2 - 1, obs.flip(0), torch.randn(size), torch.ones(size))


def test_iql_never_asks_for_the_value_of_another_action(monkeypatch: pytest.MonkeyPatch) -> None:
    agent = ImplicitAgent(made(IQL, {"critic_hidden": (8,)}), POLICY.build(2, 1), (2, 1))
    monkeypatch.setattr(agent.actor, "sample", None)
    seen = batch()
    agent.update(seen)
    loss, _ = agent.critic_loss(seen._replace(continues=torch.zeros(16)))
    values = agent.critics.network(seen.obs, seen.actions)
    assert loss.item() == pytest.approx(((values - seen.rewards) ** 2).mean(1).sum().item(), rel=1e-5)


def test_shares_of_the_dataset_in_minibatches() -> None:
    rng = np.random.default_rng(0)
    shown, flown = ReplayBuffer(4, 2, 1, rng), ReplayBuffer(4, 2, 1, rng)
    for buffer, mark in ((shown, 1.0), (flown, 2.0)):
        buffer.add(np.full((4, 9), mark, np.float32))
    for share, count in ((0.0, 0), (0.25, 8), (1.0, 32)):
        drawn = mixed(shown, flown, 32, share)
        assert int((drawn.rewards == 1.0).sum()) == count
        assert len(drawn.rewards) == 32


def test_an_expectile_of_one_has_no_end() -> None:
    with pytest.raises(InvalidValueError, match="expectile"):
        IQL(expectile=1.0)
