"""What lerobot's own tools make of our datasets is still ours: it opens with its specification, and trains."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.data.dataset import open_dataset
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.formats import lerobot
from aerial_il.policies.mlp import MLP
from tests.data.crane import crane_spec


@pytest.fixture(autouse=True)
def _offline(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("HF_HUB_OFFLINE", "HF_DATASETS_OFFLINE"):
        monkeypatch.setenv(name, "1")
    monkeypatch.setenv("HF_HOME", str(tmp_path / "hub"))


def opened(path: Path) -> Any:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    return LeRobotDataset("local/crane", root=path)


def checked(path: Path, uids: tuple[str, ...], folder: DatasetFolder, home: Path) -> None:
    """Require that a dataset holds these episodes of ours, and can be trained on."""
    found, recorded = open_dataset(path), open_dataset(folder.path)
    assert not (path / "meta" / "provenance.json").exists()
    assert found.uids == uids
    assert not found.spec.differences(crane_spec())
    for episode in found:
        of = recorded[episode.uid.partition("#")[0]]
        np.testing.assert_array_equal(episode.actions, of.labels)
        for name in of.spec.observation.state_names:
            np.testing.assert_array_equal(episode.obs[name][:-1], of.obs[name][:-1])
    settings = BC(steps=2, warmup_steps=1, validation=0.0)
    policy = settings.train(list(found), MLP(hidden=(8,), chunk=2), run=home / "run", progress=False)
    assert (policy.spec.robot, policy.spec.task) == (crane_spec().robot, crane_spec().task)


def test_after_a_delete(folder: DatasetFolder, tmp_path: Path) -> None:
    from lerobot.datasets.dataset_tools import delete_episodes

    ours = lerobot.write(open_dataset(folder.path), tmp_path / "ours")
    uids = open_dataset(ours).uids
    delete_episodes(opened(ours), episode_indices=[1], output_dir=tmp_path / "less", repo_id="local/less")
    checked(tmp_path / "less", (uids[0], *uids[2:]), folder, tmp_path)


def test_after_a_split_and_a_merge_of_what_overlaps(folder: DatasetFolder, tmp_path: Path) -> None:
    from lerobot.datasets.dataset_tools import merge_datasets, split_dataset

    ours = lerobot.write(open_dataset(folder.path), tmp_path / "ours")
    uids = open_dataset(ours).uids
    parts = split_dataset(opened(ours), {"first": [0, 1], "rest": list(range(2, len(uids)))}, output_dir=tmp_path)
    checked(tmp_path / "first", uids[:2], folder, tmp_path)
    merge_datasets([parts["first"], opened(ours)], output_repo_id="local/all", output_dir=tmp_path / "all")
    whole = (*uids[:2], *(f"{uid}#2" for uid in uids[:2]), *uids[2:])
    checked(tmp_path / "all", whole, folder, tmp_path / "merged")
