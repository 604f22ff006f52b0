"""Parts of off-policy learners: Q-learning's updates, loss and held choices, exploration, standardised critics."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file

from aerial_il import algorithms
from aerial_il.algorithms.dqn import DQN, DeepQAgent, HeldChoices
from aerial_il.algorithms.off_policy.exploration import ExplorationNoise
from aerial_il.algorithms.online.replay_buffer import Batch
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.sac import SAC
from aerial_il.core.checkpoint import ARRAYS
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.squashed_gaussian import SquashedGaussian, SquashedGaussianNetwork
from tests.algorithms.drift import Drift, demonstrations
from tests.algorithms.made import made, names

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


OBS = np.zeros((4_000, 3), np.float32)


@pytest.fixture
def actor() -> SquashedGaussianNetwork:
    torch.manual_seed(0)
    return SquashedGaussian(hidden=(4,)).build(3, 1)


def drawn(noise: ExplorationNoise, actor: SquashedGaussianNetwork, steps: int) -> np.ndarray:
    """Return what was added to the actor's centre, (steps, n)."""
    with torch.no_grad():
        centre = actor(torch.from_numpy(OBS)[:, None])[:, 0].numpy()
    return np.stack([(noise.explore(actor, OBS) - centre)[:, 0] for _ in range(steps)])


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_noise_has_its_deviation_and_correlation_at_every_step(
    actor: SquashedGaussianNetwork, correlation: float
) -> None:
    result = drawn(ExplorationNoise(0.1, correlation), actor, 20)
    np.testing.assert_allclose(result.std(axis=1), 0.1, rtol=0.06)
    between = [np.corrcoef(a, b)[0, 1] for a, b in pairwise(result)]
    np.testing.assert_allclose(between, correlation, atol=0.06)


def test_noise_goes_on_where_it_was_interrupted(actor: SquashedGaussianNetwork) -> None:
    before, after = ExplorationNoise(0.1, 0.9), ExplorationNoise(0.1, 0.9)
    drawn(before, actor, 3)
    after.restore(before.snapshot())
    torch.manual_seed(1)
    wanted = drawn(before, actor, 2)
    torch.manual_seed(1)
    np.testing.assert_array_equal(drawn(after, actor, 2), wanted)


SETTINGS = {n: algorithms.get(n) for n in algorithms.names()}
NAMES = [n for n, settings in SETTINGS.items() if "critics.layer_norm" in names(settings)]
SMALL: dict[str, Any] = {"steps": 96, "warmup": 32, "batch_size": 16, "critic_hidden": (8,), "checkpoint_every": 32}
SMALL |= {"bc_pretrain_steps": 5, "offline_steps": 8, "reward_hidden": (8,), "actor_every": 1, "utd_ratio": 0.2}


def critics_of(name: str, run: Path, **changes: Any) -> set[str]:
    """Train for a moment; return the names of all arrays that a checkpoint holds of critics' layers."""
    cls: Any = SETTINGS[name]
    settings = made(cls, {**SMALL, **changes})
    shown = settings.demonstrated
    settings.train(
        demonstrations(4, ends_at_success=True) if shown else None,
        SquashedGaussian(hidden=(8,)),
        env=Drift(8, ends_at_success=shown),
        run=run,
        seed=1,
        progress=False,
    )
    checkpoint = max((run / "checkpoints").iterdir())
    return {array for array in load_file(checkpoint / ARRAYS) if "gains" in array}


def test_algorithms_with_critics_of_actions_have_it() -> None:
    assert {"sac", "td3", "ddpg", "awac", "iql", "rlpd", "ibrl", "dac", "sqil"} <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_critics_are_standardised_only_where_that_is_asked(name: str, tmp_path: Path) -> None:
    assert critics_of(name, tmp_path / "on", critic_norm=True)
    assert not critics_of(name, tmp_path / "off", critic_norm=False)


def test_values_of_actions_that_were_never_tried_are_bounded() -> None:
    obs, far = torch.zeros(1, 3), torch.tensor([[1e4, -1e4]])
    torch.manual_seed(0)
    plain, normed = (replace(SAC.critics, layer_norm=norm).build((2, 2)) for norm in (False, True))
    assert plain(obs, far).abs().max() > 100.0
    assert normed(obs, far).abs().max() < 2.0
