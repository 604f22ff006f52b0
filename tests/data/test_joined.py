"""Several datasets are learned from together, each with its share, or it is said why they cannot."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.supervised.training_set import split
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import Dataset, open_dataset
from aerial_il.data.episode import Episode
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
    assert [demo.uid.split("/")[-2] for demo in demos.kept] == ["few.npz"] * 2 + ["many.npz"] * 6
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
    with pytest.raises(InvalidValueError, match=r"both hold episode .*a\.npz/"):
        Joined([dataset, dataset])


def test_shares_are_those_of_what_is_left_to_train_on(tmp_path: Path) -> None:
    few, many = transitions(tmp_path / "few.npz", 4), transitions(tmp_path / "many.npz", 6, steps=20)
    algorithm = BC(validation=0.3, selection=replace(BC().selection, sharpness=2.0))
    demos = algorithm.divide(Joined([few, many], [0.7, 0.3]), MLP(), seed=0)
    assert len(demos.held_out) == 3
    windows = np.array([len(demo) for demo in demos.kept]) * demos.weights
    mine = np.array(["few.npz" in demo.uid for demo in demos.kept])
    np.testing.assert_allclose(windows[mine].sum() / windows.sum(), 0.7)


def test_a_share_of_what_is_all_held_out_is_refused(tmp_path: Path) -> None:
    one, many = transitions(tmp_path / "one.npz", 1), transitions(tmp_path / "many.npz", 9)
    taken = [seed for seed in range(100) if 0 in split(range(10), 0.1, seed=seed)[1]]
    with pytest.raises(InvalidValueError, match=r"one\.npz has a share of 0\.5 .*algorithm\.validation"):
        BC(validation=0.1).divide(Joined([one, many], [0.5, 0.5]), MLP(), seed=taken[0])


def test_files_of_one_name_are_told_apart_by_their_folders(tmp_path: Path) -> None:
    for name in "ab":
        (tmp_path / name).mkdir()
    assert len(Joined([transitions(tmp_path / name / "demo.npz", 2) for name in "ab"])) == 4


def test_a_mapped_dataset_is_read_when_it_is_asked_for(tmp_path: Path) -> None:
    dataset, asked = transitions(tmp_path / "a.npz", 3), list[str]()

    def marked(episode: Episode) -> Episode:
        asked.append(episode.uid)
        return replace(episode, uid=f"{episode.uid}!")

    mapped = dataset.mapped(marked)
    assert (len(mapped), asked) == (3, [])
    assert [mapped[1].uid, *asked] == [f"{dataset.uids[1]}!", dataset.uids[1]]
