"""Minari's folders open and train, ours are datasets to Minari; nothing is imported or followed outside."""

import json
from pathlib import Path
from typing import Any

import gymnasium
import h5py
import numpy as np
import pytest

from aerial_il.cli.main import main
from aerial_il.core.errors import DemoError, InvalidValueError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.formats import minari as form

ENV, STEPS = "Pendulum-v1", (12, 9)


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """Two episodes in the layout that ``HDF5Storage`` of Minari 0.5 writes."""
    data = tmp_path / "pendulum" / "data"
    data.mkdir(parents=True)
    with h5py.File(data / "main_data.hdf5", "w") as file:
        for number, steps in enumerate(STEPS):
            rng, group = np.random.default_rng(number), file.create_group(f"episode_{number}")
            group["observations"] = rng.normal(size=(steps + 1, 3)).astype("f4")
            group["actions"], group["rewards"] = rng.uniform(-1, 1, (steps, 1)).astype("f4"), rng.normal(size=steps)
            group["terminations"], group["truncations"] = np.zeros(steps, bool), np.arange(steps) == steps - 1
    told = {"env_spec": gymnasium.spec(ENV).to_json(), "data_format": "hdf5"}
    (data / "metadata.json").write_text(json.dumps(told))
    return data.parent


def test_every_value_is_read(foreign: Path) -> None:
    dataset = open_dataset(foreign)
    assert dataset.uids == ("episode_0", "episode_1")
    assert (dataset.spec.robot, dataset.spec.task, dataset.spec.max_steps) == ("gymnasium", ENV, max(STEPS))
    with h5py.File(foreign / "data/main_data.hdf5") as file:
        raw: Any = file
        for episode in dataset:
            np.testing.assert_array_equal(episode.obs["observation"], raw[f"{episode.uid}/observations"])
            np.testing.assert_array_equal(episode.actions, raw[f"{episode.uid}/actions"])
            np.testing.assert_array_equal(episode.rewards, raw[f"{episode.uid}/rewards"])
            assert episode.truncated.tolist() == raw[f"{episode.uid}/truncations"][()].tolist()
            assert not episode.spec.differences(dataset.spec)


def test_it_trains_and_flies_in_the_environment_that_it_names(foreign: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(foreign.parent)
    small = ["algorithm.steps=2", "policy.hidden=[8]", "policy.chunk=2", "progress=false"]
    assert main(["train", f"dataset={foreign}", "run=run", "algorithm.validate_every=0", *small]) == 0
    judged = ["episodes=2", "videos=0", "out=judged", "success=survived", "max_steps=5", "progress=false"]
    assert main(["evaluate", "policy=run", *judged]) == 0


def test_what_minari_itself_wrote_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    minari = pytest.importorskip("minari", reason="Minari is not installed: python -m pip install 'minari[hdf5]'")
    rng, flown = np.random.default_rng(0), []
    for number, steps in enumerate(STEPS):
        end = [step == steps - 1 for step in range(steps)]
        told = {"rewards": rng.normal(size=steps).tolist(), "terminations": [False] * steps, "truncations": end}
        seen, done = rng.normal(size=(steps + 1, 3)).astype("f4"), rng.normal(size=(steps, 1)).astype("f4")
        flown.append(minari.data_collector.EpisodeBuffer(id=number, observations=[*seen], actions=[*done], **told))
    theirs = minari.create_dataset_from_buffers("pendulum/random-v0", buffer=flown, env=gymnasium.make(ENV))
    for episode, other in zip(open_dataset(tmp_path / "pendulum/random-v0"), theirs, strict=True):
        np.testing.assert_array_equal(episode.obs["observation"], other.observations)
        np.testing.assert_array_equal(episode.actions, other.actions)
        assert episode.spec.task == ENV


@pytest.mark.parametrize("space", ["jpeg", "ragged jpeg", "tuple", "nested", "discrete actions"])
def test_minari_s_spaces_that_are_not_read_are_named(
    space: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    minari = pytest.importorskip("minari", reason="Minari is not installed: python -m pip install 'minari[hdf5]'")
    box, picture = gymnasium.spaces.Box(-9, 9, (3,)), gymnasium.spaces.Box(0, 255, (40, 40, 3), np.uint8)
    spaces = {"tuple": gymnasium.spaces.Tuple((box, box)), "discrete actions": box}
    spaces["nested"] = gymnasium.spaces.Dict(inner=gymnasium.spaces.Dict(deep=box))
    seen = spaces.get(space, picture)
    done = gymnasium.spaces.Discrete(3) if space == "discrete actions" else box
    seen.seed(0)
    observed = [np.full((40, 40, 3), 90, np.uint8)] * 6 if space == "jpeg" else [seen.sample() for _ in range(6)]
    if space == "tuple":
        observed = tuple(map(list, zip(*observed, strict=True)))
    if space == "nested":
        observed = {"inner": {"deep": [each["inner"]["deep"] for each in observed]}}
    flown = minari.data_collector.EpisodeBuffer(
        id=0, observations=observed, actions=[done.sample() for _ in range(5)], rewards=[0.0] * 5,
        terminations=[False] * 5, truncations=[False] * 4 + [True],
    )  # fmt: skip
    minari.create_dataset_from_buffers("odd-v0", buffer=[flown], observation_space=seen, action_space=done)
    says = {"tuple": "Tuple space", "nested": "of its own", "discrete actions": "not vectors"}.get(space, "JPEG")
    with pytest.raises(DemoError, match=says):
        open_dataset(tmp_path / "odd-v0")[0]


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("observations", np.zeros((5, 3)), "observation of another length"),
        ("actions", np.zeros(12, int), "not vectors of numbers"),
        ("actions", h5py.ExternalLink("/etc/passwd", "/x"), "refers to a place outside itself"),
        ("rewards", None, "lacks /episode_0/rewards"),
    ],
)
def test_what_cannot_be_used_is_named(foreign: Path, name: str, values: object, said: str) -> None:
    with h5py.File(foreign / "data/main_data.hdf5", "a") as file:
        del file[f"episode_0/{name}"]
        if values is not None:
            file[f"episode_0/{name}"] = values
    with pytest.raises(DemoError, match=said):
        open_dataset(foreign, strict=True)
    assert open_dataset(foreign).uids == ("episode_1",)


def test_more_than_memory_is_refused_before_it_is_read(foreign: Path) -> None:
    with h5py.File(foreign / "data/main_data.hdf5", "a") as file:
        del file["episode_0/observations"]
        file.create_dataset("episode_0/observations", (10**9, 3), "f4", chunks=(1000, 3), fillvalue=1.0)
        file["episode_0"].attrs["total_steps"] = 10**9
        for name, kind in (("actions", "f4"), ("rewards", "f8"), ("terminations", bool), ("truncations", bool)):
            del file[f"episode_0/{name}"]
            width = (1,) if name == "actions" else ()
            file.create_dataset(f"episode_0/{name}", (10**9, *width), kind, chunks=(1000, *width))
    with pytest.raises(DemoError, match=r"takes too much memory\. expected at most 2000 MB, got .* MB.*memory_mb=N"):
        open_dataset(foreign, strict=True)


def test_an_environment_that_names_a_module_is_not_imported(foreign: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (foreign / "data/metadata.json").write_text(json.dumps({"env_spec": json.dumps({"id": "antigravity:X-v0"})}))
    monkeypatch.chdir(foreign.parent)
    small = ["algorithm.steps=2", "policy.hidden=[8]", "policy.chunk=2", "progress=false"]
    assert main(["train", f"dataset={foreign}", "run=run", "algorithm.validate_every=0", *small]) == 0
    assert main(["evaluate", "policy=run", "episodes=1", "out=judged"]) == 2
    assert "antigravity" not in __import__("sys").modules


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
