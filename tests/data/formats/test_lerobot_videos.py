"""Videos of LeRobot's datasets, and what lerobot's own tools make of ours: it opens, and it trains."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.cli.main import main
from aerial_il.core import language
from aerial_il.core.errors import DemoError, UnknownNameError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.formats import lerobot
from aerial_il.data.formats.parts.lerobot import reading
from aerial_il.data.formats.parts.lerobot.videos import camera_fields
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.language import in_words
from tests.data.crane import crane_spec

STEPS, SIZE = (12, 9), (64, 96, 3)
JOINTS = ["shoulder.pos", "elbow.pos"]
KEY = "observation.images.front"


def shade(episode: int, step: int) -> int:
    """Return the grey of a picture: no two of an episode are alike."""
    return 30 + 100 * episode + 8 * step


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two episodes of an arm under one task text; both lie in one video."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    root = tmp_path_factory.mktemp("foreign") / "data"
    joints = {"dtype": "float32", "shape": (2,), "names": JOINTS}
    picture = {"dtype": "video", "shape": SIZE, "names": ["height", "width", "channels"]}
    features = {"observation.state": joints, "action": joints, KEY: picture}
    dataset = LeRobotDataset.create("them/arm", 20, features, root=root, robot_type="so100", video_backend="pyav")
    for episode, steps in enumerate(STEPS):
        for step in range(steps):
            told = np.array([episode, step], np.float32)
            seen = np.full(SIZE, shade(episode, step), np.uint8)
            dataset.add_frame({"observation.state": told, "action": told / 50, KEY: seen, "task": "Fold it."})
        dataset.save_episode()
    dataset.finalize()
    return root


def test_names_texts_and_pictures_are_read(foreign: Path) -> None:
    assert len(list(foreign.rglob("*.mp4"))) == 1
    dataset = open_dataset(foreign, cameras=True)
    spec = dataset.spec
    assert (spec.robot, spec.instruction, spec.control_dt_s) == ("so100", "Fold it.", 0.05)
    assert spec.action.labels == spec.observation["observation.state"].labels == tuple(JOINTS)
    assert spec.observation["front_rgb"].shape == SIZE
    for number, episode in enumerate(dataset):
        assert episode.obs["front_rgb"].shape == (STEPS[number] + 1, *SIZE)
        greys = [shade(number, step) for step in range(STEPS[number])]
        np.testing.assert_allclose(episode.obs["front_rgb"][:-1].mean((1, 2, 3)), greys, atol=3)


def test_stills_are_read_and_task_texts_that_differ(tmp_path: Path) -> None:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    joints = {"dtype": "float32", "shape": (2,), "names": JOINTS}
    still = {"dtype": "image", "shape": (8, 8, 3), "names": ["height", "width", "channels"]}
    features = {"observation.state": joints, "action": joints, "observation.images.still": still}
    dataset = LeRobotDataset.create("them/two", 20, features, root=tmp_path / "two", use_videos=False)
    for text in ("Fold it.", "Unfold it."):
        for step in range(4):
            told = np.array([step, 0], np.float32)
            seen = np.full((8, 8, 3), step, np.uint8)
            dataset.add_frame(
                {"observation.state": told, "action": told, "observation.images.still": seen, "task": text}
            )
        dataset.save_episode()
    dataset.finalize()
    opened = open_dataset(tmp_path / "two", cameras=True)
    assert (len(opened), opened.spec.instruction) == (2, "")
    for episode in opened:
        assert episode.obs["still_rgb"][:-1, 0, 0, 0].tolist() == [0, 1, 2, 3]
    assert [episode.provenance["instruction"] for episode in opened] == ["Fold it.", "Unfold it."]
    seen = [in_words(episode).obs["instruction"] for episode in opened]
    assert [rows.shape for rows in seen] == [(5, language.SIZE)] * 2
    np.testing.assert_array_equal(seen[1][0], language.embedded("unfold it"))


def test_pictures_that_nobody_asked_for_are_not_decoded(foreign: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "read_clip", None)
    assert "front_rgb" not in open_dataset(foreign)[0].obs
    with pytest.raises(UnknownNameError, match="Did you mean 'front_rgb'"):
        open_dataset(foreign, cameras=["frontal_rgb"])


def test_a_policy_that_sees_is_trained_on_it(foreign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    small = ["policy.images=[front_rgb]", "policy.hidden=[8]", "policy.chunk=2", "algorithm.steps=2", "progress=false"]
    assert main(["train", f"dataset={foreign}", "run=run", "algorithm.validate_every=0", *small]) == 0


@pytest.fixture
def copy(foreign: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(foreign, tmp_path / "copy"))


def tell(root: Path, **changes: object) -> None:
    info = json.loads((root / "meta/info.json").read_text())
    (root / "meta/info.json").write_text(json.dumps({**info, **changes}))


def test_a_damaged_video_is_named(copy: Path) -> None:
    video = next(copy.rglob("*.mp4"))
    video.write_bytes(b"no video at all")
    with pytest.raises(DemoError, match=r"file-000\.mp4: cannot be decoded"):
        open_dataset(copy, cameras=True)[0]
    video.unlink()
    with pytest.raises(DemoError, match=r"file-000\.mp4: is missing"):
        open_dataset(copy, cameras=True)[0]
    assert len(open_dataset(copy)[0]) == STEPS[0], "what does not look at it can be read"


def test_pictures_are_looked_for_inside_the_dataset_only(copy: Path, foreign: Path) -> None:
    video = next(copy.rglob("*.mp4"))
    video.unlink()
    video.symlink_to(next(foreign.rglob("*.mp4")))
    with pytest.raises(DemoError, match="refers to a place outside itself"):
        open_dataset(copy, cameras=True)[0]


def test_more_than_memory_is_refused_before_it_is_decoded(copy: Path) -> None:
    features = json.loads((copy / "meta/info.json").read_text())["features"]
    tell(copy, features={**features, KEY: {**features[KEY], "shape": [60_000, 60_000, 3]}})
    with pytest.raises(DemoError, match=r"too much memory\. expected at most 2000 MB.*memory_mb=N"):
        open_dataset(copy, cameras=True)[0]
    tell(copy, features={**features, KEY: {**features[KEY], "shape": [32, 32, 3]}})
    with pytest.raises(DemoError, match="has pictures of another size"):
        open_dataset(copy, cameras=True)[0]


def test_a_video_that_is_too_short_is_no_episode(copy: Path) -> None:
    file = next((copy / "meta/episodes").rglob("*.parquet"))
    table = pq.read_table(file)
    late = table.column(f"videos/{KEY}/from_timestamp").to_pylist()
    place = table.column_names.index(f"videos/{KEY}/from_timestamp")
    pq.write_table(table.set_column(place, table.column_names[place], [[time + 0.3 for time in late]]), file)
    with pytest.raises(DemoError, match=r"lacks pictures of an episode\. expected 9, got 3"):
        open_dataset(copy, cameras=True)[1]


def test_what_is_no_colour_video_is_no_camera() -> None:
    video = {"dtype": "video", "shape": [3, 48, 64], "names": ["channels", "height", "width"]}
    depth = {**video, "info": {"video.is_depth_map": True}}
    features = {"observation.images.a": video, "observation.images.b": depth, "c": {**video, "dtype": "float32"}}
    (only,) = camera_fields(features)
    assert (only.name, only.shape) == ("a_rgb", (48, 64, 3))


def opened(path: Path) -> Any:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    return LeRobotDataset("local/crane", root=path)


def checked(path: Path, uids: tuple[str, ...], folder: DatasetFolder, home: Path) -> None:
    """Require that a dataset holds these episodes of ours, and can be trained on."""
    result, recorded = open_dataset(path), open_dataset(folder.path)
    assert not (path / "meta" / "provenance.json").exists()
    assert result.uids == uids
    assert not result.spec.differences(crane_spec())
    for episode in result:
        of = recorded[episode.uid.partition("#")[0]]
        np.testing.assert_array_equal(episode.actions, of.labels)
        for name in of.spec.observation.state_names:
            np.testing.assert_array_equal(episode.obs[name][:-1], of.obs[name][:-1])
    settings = BC(steps=2, warmup_steps=1, validation=0.0)
    policy = settings.train(list(result), MLP(hidden=(8,), chunk=2), run=home / "run", progress=False)
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
