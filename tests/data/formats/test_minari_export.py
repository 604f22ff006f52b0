"""What is written for Minari is a dataset to Minari itself, and keeps to us what it was recorded with."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from aerial_il.core.errors import DemoError, InvalidValueError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.formats import minari as form


@pytest.fixture
def written(folder: DatasetFolder, tmp_path: Path) -> Path:
    return form.write(open_dataset(folder.path, failures=True), tmp_path / "root" / "cranes-v2")


def test_it_comes_back_as_it_was_recorded(folder: DatasetFolder, written: Path) -> None:
    recorded, back = open_dataset(folder.path, failures=True), open_dataset(written)
    assert len(back) == len(recorded)
    for mine, theirs in zip(back, recorded, strict=True):
        assert not mine.spec.differences(theirs.spec, ignore=("state_size", "instruction"))
        assert mine.success == theirs.success
        assert mine.obs.keys() == theirs.obs.keys()
        assert all(np.array_equal(mine.obs[name], theirs.obs[name]) for name in theirs.obs)
        np.testing.assert_array_equal(mine.actions, theirs.labels)
        np.testing.assert_array_equal(mine.rewards, theirs.rewards)
    assert {episode.success for episode in back} == {True, False}


def test_minari_itself_reads_it(folder: DatasetFolder, written: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(written.parent))
    minari = pytest.importorskip("minari", reason="Minari is not installed: python -m pip install 'minari[hdf5]'")
    theirs, recorded = minari.load_dataset("cranes-v2"), open_dataset(folder.path, failures=True)
    assert (theirs.total_episodes, theirs.total_steps) == (len(recorded), sum(map(len, recorded)))
    for read, episode in zip(theirs, recorded, strict=True):
        assert all(np.array_equal(read.observations[name], episode.obs[name]) for name in episode.obs)
        np.testing.assert_array_equal(read.actions, episode.labels)
        assert theirs.action_space.contains(read.actions[0])
        assert theirs.observation_space.contains({name: values[0] for name, values in read.observations.items()})
        assert read.terminations[-1] != read.truncations[-1]
        assert not (read.terminations[:-1] | read.truncations[:-1]).any()


def test_another_name_or_another_s_folder_is_refused(folder: DatasetFolder, written: Path, tmp_path: Path) -> None:
    episodes = list(open_dataset(folder.path))
    with pytest.raises(InvalidValueError, match=r"NAME-vN, e.g. .*flights-v0"):
        form.write(episodes, tmp_path / "cranes")
    (tmp_path / "mine-v0").mkdir()
    with pytest.raises(InvalidValueError, match="holds no dataset of Minari's"):
        form.write(episodes, tmp_path / "mine-v0")
    form.write(episodes[:1], written)
    assert len(open_dataset(written)) == 1
    assert [path.name for path in written.parent.iterdir()] == ["cranes-v2"]


def test_a_specification_of_other_arrays_is_refused(written: Path) -> None:
    told = json.loads((written / "data/metadata.json").read_text())
    spec = json.loads(told["aerial_il_spec"])
    spec["observation"]["fields"][0]["shape"] = [10**9]
    for changed, says in (
        (json.dumps(spec), "another shape than others or its specification"),
        ("{}", "malformed aerial_il_spec"),
    ):
        (written / "data/metadata.json").write_text(json.dumps({**told, "aerial_il_spec": changed}))
        with pytest.raises(DemoError, match=says):
            open_dataset(written)[0]


def test_pictures_are_kept_as_they_are(folder: DatasetFolder, written: Path) -> None:
    rng = np.random.default_rng(0)
    with h5py.File(written / "data/main_data.hdf5", "a") as file:
        for episode in map(str, file):
            steps = file[f"{episode}/actions"].shape[0]
            del file[f"{episode}/observations"]
            file[f"{episode}/observations/front"] = rng.integers(0, 255, (steps + 1, 32, 40, 3), np.uint8)
    told = json.loads((written / "data/metadata.json").read_text())
    del told["aerial_il_spec"]
    (written / "data/metadata.json").write_text(json.dumps(told))
    pictured = open_dataset(written, cameras=True)[0]
    assert pictured.obs["front"].dtype == np.uint8
    assert pictured.spec.observation["front"].group == "image"
