"""Several datasets are learned from together, each with its share, or it is said why they cannot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import Dataset, open_dataset
from aerial_il.data.joined import Joined
from aerial_il.policies.mlp import MLP


def transitions(path: Path, episodes: int, *, width: int = 2, steps: int = 10) -> Dataset:
    rng = np.random.default_rng(episodes)
    shape = (episodes * steps, width)
    dones = np.tile(np.arange(steps) == steps - 1, episodes)
    np.savez(path, obs=rng.normal(size=shape), acts=rng.normal(size=shape), dones=dones)
    return open_dataset(path)


def test_each_dataset_has_its_share_of_the_windows(tmp_path: Path) -> None:
    few, many = transitions(tmp_path / "few.npz", 2), transitions(tmp_path / "many.npz", 6, steps=20)
    demos = BC(validation=0.0).divide(Joined([few, many], [0.7, 0.3]), MLP(), seed=0)
    windows = np.array([len(demo) for demo in demos.kept]) * demos.weights
    assert [demo.uid.split("/")[0] for demo in demos.kept] == ["few"] * 2 + ["many"] * 6
    np.testing.assert_allclose(windows[:2].sum() / windows.sum(), 0.7)


def test_without_weights_each_step_counts_the_same(tmp_path: Path) -> None:
    both = Joined([transitions(tmp_path / "a.npz", 2), transitions(tmp_path / "b.npz", 3)])
    assert np.ptp(BC(validation=0.0).divide(both, MLP(), seed=0).weights) == 0


@pytest.mark.parametrize(
    ("weights", "said"),
    [([1.0], "2 datasets and 1 dataset.weights"), ([1.0, -1.0], "has -1.0"), ([0.0, 0.0], "has 0.0")],
)
def test_weights_that_cannot_be_are_refused(weights: list[float], said: str, tmp_path: Path) -> None:
    datasets = [transitions(tmp_path / f"{name}.npz", 2) for name in "ab"]
    with pytest.raises(InvalidValueError, match=said):
        Joined(datasets, weights)


def test_what_differs_between_datasets_is_named(tmp_path: Path) -> None:
    datasets = [transitions(tmp_path / "a.npz", 2), transitions(tmp_path / "b.npz", 2, width=3)]
    with pytest.raises(InvalidValueError, match=r"a\.npz and .*b\.npz cannot be learned.*action"):
        Joined(datasets)


def test_the_same_dataset_twice_is_refused(tmp_path: Path) -> None:
    dataset = transitions(tmp_path / "a.npz", 2)
    with pytest.raises(InvalidValueError, match=r"both hold episode a/"):
        Joined([dataset, dataset])
