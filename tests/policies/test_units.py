"""Data in metres, millimetres or micrometres give the same policy: no threshold is told in a unit."""

from pathlib import Path

import numpy as np
import pytest
import torch

from aerial_il import policies
from aerial_il.algorithms.adversarial.discriminator import RunningNorm
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.on_policy.advantages import RewardNorm
from aerial_il.algorithms.online.demonstrations import read_transitions
from aerial_il.algorithms.online.interface import encode, encode_actions, fit_interface
from aerial_il.algorithms.online.moments import RunningMoments
from aerial_il.data.dataset import Dataset, open_dataset
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunk_policy import ChunkPolicy

UNITS = (1e-6, 1e-3, 1e3, 1e6)
STEPS, EPISODES = 30, 6
unit = pytest.mark.parametrize("unit", UNITS)


def recorded(folder: Path, unit: float) -> Dataset:
    """Open episodes whose actions follow from what is seen; positions, and two of three actions, are told in units.

    An element of each never varies.
    """
    rng, last = np.random.default_rng(0), np.arange(STEPS) == STEPS - 1
    seen = [0.3 * rng.normal(size=(STEPS, 3)).cumsum(0) for _ in range(EPISODES)]
    obs = np.concatenate([np.column_stack([x * [unit, unit, 1.0], np.full(STEPS, 0.7 * unit)]) for x in seen])
    acts = np.concatenate(
        [np.column_stack([np.tanh(x) * [4e-4 * unit, unit, 1.0], np.full(STEPS, 0.2 * unit)]) for x in seen]
    )
    file = folder / f"{unit:g}.npz"
    np.savez(file, obs=obs, acts=acts, rews=np.ones(len(obs)), terminals=np.tile(last, EPISODES))
    return open_dataset(file)


def learned(folder: Path, unit: float, name: str, steps: int, **settings: object) -> tuple[ChunkPolicy, Dataset]:
    dataset = recorded(folder, unit)
    config = policies.get(name)(**settings)
    training = BC(steps=steps, warmup_steps=5, batch_size=64, validation=0.0, ema=0.0, lr=3e-3)
    return training.train(dataset, config, run=folder / f"{name}{unit:g}", progress=False), dataset


def fit_of(policy: ChunkPolicy, dataset: Dataset) -> np.ndarray:
    """Return R² of each action element that varies."""
    episodes = list(dataset)
    told = np.concatenate([episode.actions for episode in episodes])[:, :3]
    answers = []
    for episode in episodes:
        policy.reset(np.ones(1, bool))
        answers += [policy.act({"observation": episode.obs["observation"][t][None]})[0] for t in range(len(episode))]
    return 1 - ((np.array(answers)[:, :3] - told) ** 2).sum(0) / ((told - told.mean(0)) ** 2).sum(0)


def test_a_policy_fits_as_well_in_any_unit(tmp_path: Path) -> None:
    small = {"chunk": 1, "hidden": (64,)}
    fits = {each: fit_of(*learned(tmp_path, each, "mlp", 300, **small)) for each in (1.0, *UNITS)}
    assert fits[1.0].min() > 0.95
    for each in UNITS:
        np.testing.assert_allclose(fits[each], fits[1.0], atol=0.01)


@pytest.mark.parametrize("name", sorted({*policies.names()} - {"categorical"}))
def test_every_policy_sees_and_answers_alike(name: str, tmp_path: Path) -> None:
    (one, ours), (other, theirs) = (learned(tmp_path, each, name, 3) for each in (1.0, 1e-6))
    windows = np.concatenate([episode.obs["observation"][:-1] for episode in ours])[:, None]
    scaled = np.concatenate([episode.obs["observation"][:-1] for episode in theirs])[:, None]
    np.testing.assert_allclose(one.interface.encode_obs(windows), other.interface.encode_obs(scaled), atol=1e-4)
    for name_, weights in one.network.state_dict().items():
        np.testing.assert_allclose(weights, other.network.state_dict()[name_], atol=2e-3)


@unit
def test_critics_and_discriminators_see_the_same(unit: float, tmp_path: Path) -> None:
    rows = []
    for each in (1.0, unit):
        options = {"trajectories": None, "subsample": 1, "seed": 0}
        layout, shown, _ = read_transitions(recorded(tmp_path, each), config := MLP(), **options)
        interface = fit_interface(layout, shown.frames, shown.actions, policy=config, bounds="demonstrations")
        rows.append(
            np.hstack([encode(interface, shown.frames), encode_actions(interface, shown.actions, shown.frames)])
        )
        norm = RunningNorm(layout.size)
        norm.add(torch.tensor(shown.frames, dtype=torch.float32))
        rows[-1] = np.hstack([rows[-1], norm(torch.tensor(shown.frames, dtype=torch.float32)).numpy()])
        moments = RunningMoments(layout.size)
        moments.add(shown.frames)
        rows[-1] = np.hstack([rows[-1], moments.normaliser().normalise(shown.frames)])
    np.testing.assert_allclose(rows[1], rows[0], atol=2e-3)
    assert np.ptp(rows[0], axis=0).max() > 1.0


@unit
def test_returns_are_scaled_alike(unit: float) -> None:
    rewards, ended = np.random.default_rng(0).normal(1.0, 0.3, (50, 4)), np.zeros((50, 4), bool)
    ours, theirs = (RewardNorm(4, 0.99).scale(rewards * each, ended) for each in (1.0, unit))
    np.testing.assert_allclose(theirs, ours, rtol=1e-9)


def test_what_never_varies_stays_harmless_in_any_unit() -> None:
    moments = RunningMoments(4)
    noise = 1e-17 * np.random.default_rng(0).normal(size=(100, 1))
    moments.add(
        np.hstack([np.full((100, 1), 5e6), np.zeros((100, 1)), noise, np.random.default_rng(1).normal(size=(100, 1))])
    )
    assert (np.abs(moments.normaliser().normalise(np.array([[5e6, 0.0, 1e-15, 0.0]]))) < 1).all()
    np.testing.assert_array_equal(moments.deviation[:3], [5e6, 1.0, 1.0])
