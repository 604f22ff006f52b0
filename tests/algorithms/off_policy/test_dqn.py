"""Parts of deep Q-learning: blocks of updates, the loss of errors, and random choices that are held."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import torch

from aerial_il.algorithms.dqn import DQN, DeepQAgent, HeldChoices
from aerial_il.algorithms.online.replay_buffer import Batch
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.categorical import Categorical

CHOICES = Categorical(hidden=(16,), choices="bounds")


def due(steps: int, worlds: int, every: int) -> int:
    """Return how many updates fall due after a turn of one step, one for each two steps."""
    run: Any = SimpleNamespace(collector=SimpleNamespace(steps=steps, n=worlds))
    return OnlineRun.updates_due(run, 0.5, every)


@pytest.mark.parametrize("worlds", [1, 3])
def test_updates_in_blocks_are_as_many(worlds: int) -> None:
    turns = range(worlds, 241, worlds)
    evenly, bouts = ([due(steps, worlds, every) for steps in turns] for every in (1, 24))
    assert sum(bouts) == sum(evenly) == 120
    assert {steps % 24 for steps, count in zip(turns, bouts, strict=True) if count} == {0}
    assert max(evenly) == 1 + (worlds > 1)
    with pytest.raises(InvalidValueError, match="update_every"):
        DQN(update_every=0)


@pytest.mark.parametrize(("huber", "loss"), [(1.0, 49.5), (20.0, 800.0), (100.0, 1250.0)])
def test_the_loss_grows_linearly_beyond_the_huber_threshold(huber: float, loss: float) -> None:
    network = CHOICES.build(2, 1)
    for parameter in network.parameters():
        torch.nn.init.zeros_(parameter)
    end = Batch(
        obs=torch.zeros(4, 3), actions=torch.zeros(4, 1), rewards=torch.full((4,), -50.0),
        next_obs=torch.zeros(4, 3), continues=torch.zeros(4),
    )  # fmt: skip
    metrics = DeepQAgent(DQN(huber=huber), network).update(end)
    assert metrics["critic/loss"] == pytest.approx(loss)


def test_random_choices_are_held() -> None:
    torch.manual_seed(0)
    best, held = torch.full((500,), 7), HeldChoices(3, longest=20)
    taken = torch.stack([held.instead_of(best, 0.1) for _ in range(200)])
    random = taken != 7
    assert {*taken[random].tolist()} == {0, 1, 2}
    again = (taken[1:] == taken[:-1])[random[1:] & random[:-1]]
    assert 0.8 < again.double().mean() < 1.0, "held, and followed by another draw at times"
    assert 0.15 < random.double().mean() < 0.25, "a tenth of the free steps begin two of them on average"


def test_a_hold_of_one_step_is_epsilon_greedy() -> None:
    torch.manual_seed(0)
    best, single = torch.full((20_000,), 7), HeldChoices(4, longest=1)
    for _ in range(2):
        assert (single.instead_of(best, 0.3) != 7).double().mean() == pytest.approx(0.3, abs=0.02)
    held, other = HeldChoices(4, longest=50), HeldChoices(4, longest=50)
    held.instead_of(best, 1.0)
    other.restore(held.snapshot())
    goes_on = held.instead_of(best, 0.0)
    assert 0.3 < (goes_on != 7).double().mean() < 0.45, "all but those of a single step, 1 / 1.625"
    assert torch.equal(other.instead_of(best, 0.0), goes_on)
