"""The LeRobot form holds what was recorded, lerobot itself opens and trains on it, and an incomplete one is refused."""

import fcntl
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.collection.collect import collect
from aerial_il.core.errors import DemoError, StorageError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.formats.lerobot import write
from aerial_il.data.formats.parts.lerobot import files
from aerial_il.data.formats.parts.lerobot.writing import write_states, write_with_lerobot
from aerial_il.policies.mlp import MLP
from tests.data.crane import CraneBatch, CraneExpert


@pytest.fixture(scope="module")
def derived(folder: DatasetFolder, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(open_dataset(folder.path), tmp_path_factory.mktemp("derived") / "lerobot")


def test_every_value_is_kept(folder: DatasetFolder, derived: Path) -> None:
    recorded, converted = open_dataset(folder.path), open_dataset(derived)
    assert converted.uids == recorded.uids
    for ours, theirs in zip(recorded, converted, strict=True):
        assert theirs.spec == ours.spec
        assert theirs.success
        assert theirs.seed == ours.seed
        np.testing.assert_array_equal(theirs.actions, ours.expert_actions)
        np.testing.assert_array_equal(theirs.rewards, ours.rewards)
        for name in ours.spec.observation.state_names:
            np.testing.assert_array_equal(theirs.obs[name][:-1], ours.obs[name][:-1])


def test_lerobot_opens_it(folder: DatasetFolder, derived: Path) -> None:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    dataset = LeRobotDataset("local/crane-reach", root=derived, delta_timestamps={"action": [0.0, 0.02]})
    episodes = list(open_dataset(folder.path))
    assert (dataset.num_episodes, len(dataset)) == (len(episodes), sum(map(len, episodes)))
    assert dataset.meta.features["observation.state"]["names"][:3] == ["base_pos.x", "base_pos.y", "base_pos.z"]
    first = dataset[0]
    np.testing.assert_allclose(first["action"], episodes[0].actions[:2], rtol=1e-6)
    np.testing.assert_allclose(first["observation.environment_state"], episodes[0].obs["goal_pos"][0], rtol=1e-6)
    assert first["task"] == "Bring the hook to the ball."
    assert first["demo.uid"] == episodes[0].uid
    last = dataset[len(episodes[0]) - 1]
    assert last["next.done"]
    assert last["next.success"]


def test_every_file_is_what_lerobots_own_writer_writes(folder: DatasetFolder, tmp_path: Path) -> None:
    """Only the fingerprint that Hugging Face gives a table in memory is not in ours."""
    episodes = open_dataset(folder.path)
    write_states(tmp_path / "ours", episodes.spec, episodes)
    write_with_lerobot(tmp_path / "theirs", episodes.spec, (), episodes)
    ours, theirs = (
        {f.relative_to(root): f for f in root.rglob("*.*")} for root in (tmp_path / "ours", tmp_path / "theirs")
    )
    assert ours.keys() == theirs.keys()
    assert len(ours) == 5
    for name, file in theirs.items():
        if name.suffix == ".parquet":
            assert_equal_tables(pq.read_table(ours[name]), pq.read_table(file))
        else:
            assert ours[name].read_bytes() == file.read_bytes()


def assert_equal_tables(ours: pa.Table, theirs: pa.Table) -> None:
    assert ours.schema.equals(theirs.schema)
    for name in theirs.column_names:
        assert ours[name].equals(theirs[name]), name
    assert told(ours.schema) == told(theirs.schema)


def told(schema: pa.Schema) -> dict[bytes, object]:
    """Return the metadata of a schema, without the fingerprint."""
    metadata = dict(schema.metadata or {})
    features = json.loads(metadata.pop(b"huggingface", b"{}"))
    features.pop("fingerprint", None)
    return {**metadata, b"huggingface": features}


def test_files_are_split_where_lerobot_splits_them(
    folder: DatasetFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from lerobot.datasets import dataset_metadata

    create = dataset_metadata.create_empty_dataset_info

    def small(*args: object) -> object:
        return create(*args[:6], 0.01, *args[7:])

    monkeypatch.setattr(dataset_metadata, "create_empty_dataset_info", small)
    episodes = open_dataset(folder.path)
    write_states(tmp_path / "ours", episodes.spec, episodes)
    write_with_lerobot(tmp_path / "theirs", episodes.spec, (), episodes)
    ours, theirs = (sorted((tmp_path / side / "data").rglob("*.parquet")) for side in ("ours", "theirs"))
    assert len(ours) == len(theirs) > 1
    for mine, other in zip(ours, theirs, strict=True):
        assert_equal_tables(pq.read_table(mine), pq.read_table(other))


def test_lerobots_own_act_trains_on_it(derived: Path) -> None:
    """Everything from the dataset to the optimiser is made by lerobot from a configuration alone."""
    import torch
    from lerobot.configs.default import DatasetConfig
    from lerobot.configs.train import TrainPipelineConfig
    from lerobot.datasets.factory import make_train_eval_datasets
    from lerobot.optim.factory import make_optimizer_and_scheduler
    from lerobot.policies import make_policy, make_pre_post_processors
    from lerobot.policies.act.configuration_act import ACTConfig

    sizes = {"dim_model": 32, "n_heads": 2, "dim_feedforward": 64, "n_encoder_layers": 1}
    act = ACTConfig(device="cpu", push_to_hub=False, chunk_size=8, n_action_steps=8, **sizes)
    data = DatasetConfig(repo_id="local/crane-reach", root=str(derived))
    config = TrainPipelineConfig(dataset=data, policy=act, optimizer=act.get_optimizer_preset())
    dataset = make_train_eval_datasets(config)[0]
    torch.manual_seed(0)
    policy = make_policy(act, ds_meta=dataset.meta)
    assert set(act.input_features) == {"observation.state", "observation.environment_state"}
    before, _ = make_pre_post_processors(act, dataset_stats=dataset.meta.stats)
    optimizer, _ = make_optimizer_and_scheduler(config, policy)
    losses = []
    for batch in list(torch.utils.data.DataLoader(dataset, batch_size=16, shuffle=True))[:3]:
        loss, _ = policy.forward(before(batch))
        loss.backward()
        optimizer.step()
        optimizer.zero_grad()
        losses.append(loss.item())
    assert np.isfinite(losses).all()


def test_cameras_become_videos(tmp_path: Path) -> None:
    env = CraneBatch(1, image_size=(64, 96), max_steps=70)
    collect(env, CraneExpert(), [0], tmp_path, progress=False)
    env.close()
    derived = write(open_dataset(tmp_path, cameras=True), tmp_path / "derived")
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    dataset, episode = LeRobotDataset("local/crane-reach", root=derived), open_dataset(tmp_path, cameras=True)[0]
    frame = dataset[10]["observation.images.scene"].permute(1, 2, 0).numpy() * 255
    assert np.abs(frame - episode.obs["scene_rgb"][10]).mean() < 6
    theirs = open_dataset(derived, cameras=["scene_rgb"])[0]
    assert theirs.obs["scene_rgb"].shape == episode.obs["scene_rgb"].shape
    assert np.abs(theirs.obs["scene_rgb"][10].astype(float) - episode.obs["scene_rgb"][10]).mean() < 6
    video = next(derived.rglob("*.mp4"))
    video.write_bytes(video.read_bytes()[:-100])
    with pytest.raises(DemoError, match=r"file-000\.mp4: is missing or cut"):
        open_dataset(derived)


def cut(name: str) -> Callable[[Path], None]:
    def damage(root: Path) -> None:
        file = root / name
        file.write_bytes(file.read_bytes()[:-20])

    return damage


def lose(name: str) -> Callable[[Path], None]:
    return lambda root: (root / name).unlink()


def tell(**changes: object) -> Callable[[Path], None]:
    def damage(root: Path) -> None:
        file = root / "meta/info.json"
        file.write_text(json.dumps({**json.loads(file.read_text()), **changes}))

    return damage


DATA, EPISODES = "data/chunk-000/file-000.parquet", "meta/episodes/chunk-000/file-000.parquet"


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (cut(DATA), "data/chunk-000/file-000.parquet: is cut or damaged"),
        (cut(EPISODES), "meta/episodes/chunk-000/file-000.parquet: is cut or damaged"),
        (lose(DATA), "data: is missing"),
        (lose(EPISODES), "episodes do not add up"),
        (lose("meta/stats.json"), "stats.json: is missing or cut"),
        (cut("meta/info.json"), "info.json: cannot be read"),
        (cut("meta/provenance.json"), "provenance.json: cannot be read"),
        (tell(total_frames=1), "frames do not add up. expected 1"),
        (tell(codebase_version="v2.1"), "another LeRobot version"),
        (tell(data_path="../../etc/{chunk_index}"), "refers to a place outside itself"),
    ],
)
def test_an_incomplete_dataset_is_refused(derived: Path, tmp_path: Path, damage: Callable, says: str) -> None:
    copy = shutil.copytree(derived, tmp_path / "copy")
    damage(copy)
    with pytest.raises(DemoError, match=says):
        open_dataset(copy)


def test_a_foreign_dataset_is_read_from_its_columns(derived: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(derived, tmp_path / "copy")
    (copy / "meta/provenance.json").unlink()
    info = json.loads((copy / "meta/info.json").read_text())
    info["features"]["demo.uid"]["names"] = None
    (copy / "meta/info.json").write_text(json.dumps(info))
    episode, ours = open_dataset(copy)[0], open_dataset(derived)[0]
    assert episode.spec.observation.names == ("observation.state", "observation.environment_state")
    np.testing.assert_array_equal(episode.actions, ours.actions)
    settings = BC(steps=2, warmup_steps=1, validation=0.0)
    policy = settings.train(list(open_dataset(copy)), MLP(hidden=(8,), chunk=2), run=tmp_path / "run", progress=False)
    assert policy.spec.is_foreign, "the shipped anchor is not among its fields"


def test_a_large_dataset_lies_on_disk_and_reads_the_same(derived: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    held = open_dataset(derived)[-1]
    monkeypatch.setattr(files, "HELD_BYTES", 0)
    mapped = open_dataset(derived)[-1]
    np.testing.assert_array_equal(mapped.actions, held.actions)
    assert mapped.uid == held.uid
    for name, values in held.obs.items():
        np.testing.assert_array_equal(mapped.obs[name], values)
    monkeypatch.setenv("TMPDIR", str(derived / "nowhere"))
    with pytest.raises(StorageError, match=r"nowhere.*TMPDIR"):
        open_dataset(derived)


def test_a_failed_conversion_leaves_the_older_one(folder: DatasetFolder, tmp_path: Path) -> None:
    copy = DatasetFolder(shutil.copytree(folder.path, tmp_path / "copy"))
    older = write(open_dataset(copy.path), copy.path / "derived" / "lerobot")
    victim = copy.files()[-1]
    victim.write_bytes(victim.read_bytes()[:-1])
    with pytest.raises(DemoError, match=victim.name):
        write(open_dataset(copy.path, strict=True), older)
    assert len(open_dataset(older)) == len(copy.files())
    assert [p.name for p in older.parent.iterdir()] == ["lerobot"]


def test_what_kills_left_is_cleared_but_not_what_others_write(folder: DatasetFolder, tmp_path: Path) -> None:
    out = tmp_path / "lerobot"
    dead, alive = tmp_path / ".lerobot.1.tmp", tmp_path / ".lerobot.2.tmp"
    for holder in (dead, alive):
        (holder / "new" / "data").mkdir(parents=True)
    handle = os.open(alive, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    write(open_dataset(folder.path), out)
    assert sorted(p.name for p in tmp_path.iterdir()) == [".lerobot.2.tmp", "lerobot"]
    os.close(handle)


def test_a_kill_while_replacing_gives_the_older_one_back(folder: DatasetFolder, derived: Path, tmp_path: Path) -> None:
    shutil.copytree(derived, tmp_path / ".lerobot.1.tmp" / "old")
    copy = DatasetFolder(shutil.copytree(folder.path, tmp_path / "copy"))
    copy.files()[-1].write_bytes(b"damaged")
    with pytest.raises(DemoError):
        write(open_dataset(copy.path, strict=True), tmp_path / "lerobot")
    assert len(open_dataset(tmp_path / "lerobot")) == len(folder.files())
