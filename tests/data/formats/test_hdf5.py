"""robomimic files keep everything that was recorded, foreign ones open, and none reaches outside itself."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from aerial_il.core.errors import DemoError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.formats import d4rl, robomimic
from aerial_il.data.formats.parts import whole
from aerial_il.data.formats.parts.content_digest import content_digest
from aerial_il.data.formats.parts.whole import replacing
from aerial_il.data.replay import replay
from tests.data.crane import CraneBatch
from tests.data.recording.test_damage import episodes_equal


@pytest.fixture
def file(folder: DatasetFolder, tmp_path: Path) -> Path:
    return robomimic.write(open_dataset(folder.path, failures=True), tmp_path / "robomimic.hdf5")


def test_nothing_is_lost(folder: DatasetFolder, file: Path) -> None:
    recorded, converted = open_dataset(folder.path, failures=True), open_dataset(file)
    assert converted.uids == recorded.uids
    assert all(episodes_equal(a, b) for a, b in zip(recorded, converted, strict=True))
    assert replay(CraneBatch(), converted[0]) == len(converted[0])
    with h5py.File(file) as raw:
        assert raw["data"].attrs["total"] == sum(map(len, recorded))
        assert raw["data/demo_0/dones"][-1] == 1
        np.testing.assert_array_equal(raw["data/demo_0/next_obs/ee_pos"][:-1], raw["data/demo_0/obs/ee_pos"][1:])


def test_a_foreign_file_opens(file: Path) -> None:
    ours = open_dataset(file)[0]
    with h5py.File(file, "a") as raw:
        for demo in raw["data"].values():
            del demo["aerial_il"], demo.attrs["uid"]
        raw.move("data/demo_1", "data/demo_10")
    foreign = open_dataset(file)
    assert foreign.uids == ("demo_0", "demo_2", "demo_3", "demo_4", "demo_5", "demo_10")
    np.testing.assert_array_equal(foreign[0].actions, ours.labels)
    np.testing.assert_array_equal(foreign[0].obs["ee_pos"], ours.obs["ee_pos"])


def test_others_learn_what_the_expert_would_have_done(file: Path, tmp_path: Path) -> None:
    """As from the other formats; what was commanded, disturbed or by a learner, is read back by us."""
    flown = open_dataset(file)[0]
    asked = replace(flown, expert_actions=flown.actions + 0.01)
    taught = robomimic.write([asked], tmp_path / "taught.hdf5")
    with h5py.File(taught) as raw:
        np.testing.assert_array_equal(raw["data/demo_0/actions"], asked.expert_actions)
    np.testing.assert_array_equal(open_dataset(taught)[0].actions, flown.actions)
    with h5py.File(taught, "a") as raw:
        raw["data/demo_0/actions"][0] += 1.0
    with pytest.raises(DemoError, match="was changed after it was written"):
        open_dataset(taught)[0]


def test_a_success_that_time_ended_is_no_terminal(file: Path, tmp_path: Path) -> None:
    flown = open_dataset(file)[0]
    assert flown.success
    for late in (False, True):
        ends = np.arange(len(flown)) == len(flown) - 1
        flight = replace(flown, terminated=np.zeros(len(flown), bool), truncated=ends & late)
        with h5py.File(d4rl.write([flight], tmp_path / "d4rl.hdf5")) as raw:
            assert (raw["terminals"][-1], raw["timeouts"][-1]) == (not late, late)


def test_demonstrations_of_one_name_are_not_lost_in_silence(file: Path) -> None:
    with h5py.File(file, "a") as raw:
        raw["data/demo_1"].attrs["uid"] = raw["data/demo_0"].attrs["uid"]
    with pytest.raises(DemoError, match="names 1 of its 6 demonstrations as others by uid"):
        open_dataset(file)


def test_links_and_damage_are_refused(file: Path, tmp_path: Path) -> None:
    secret = tmp_path / "secret.bin"
    secret.write_bytes(bytes(800))
    with h5py.File(file, "a") as raw:
        del raw["data/demo_0/rewards"], raw["data/demo_1/rewards"], raw["data/demo_2/actions"]
        raw["data/demo_0/rewards"] = h5py.ExternalLink(str(tmp_path / "other.hdf5"), "/x")
        raw["data/demo_1"].create_dataset("rewards", (100,), float, external=[(str(secret), 0, 800)])
    dataset = open_dataset(file)
    for i, says in enumerate(("outside itself: /data/demo_0/rewards", "outside itself: /data/demo_1/rewards", "lacks")):
        with pytest.raises(DemoError, match=says):
            dataset[i]
    file.write_bytes(file.read_bytes()[:1000])
    with pytest.raises(DemoError, match="cannot be read as HDF5"):
        open_dataset(file)


def test_values_without_their_digest_are_refused(file: Path) -> None:
    with h5py.File(file, "a") as raw:
        del raw["data/demo_0/aerial_il"].attrs["digest"]
    with pytest.raises(DemoError, match="was changed after it was written"):
        open_dataset(file)[0]


def test_a_specification_of_before_a_key_was_added_is_read(file: Path) -> None:
    episode = open_dataset(file)[0]
    with h5py.File(file, "a") as raw:
        attributes = raw["data/demo_0/aerial_il"].attrs
        older = {key: value for key, value in json.loads(attributes["spec"]).items() if key != "options"}
        attributes["spec"], attributes["digest"] = json.dumps(older), content_digest(episode, older)
    assert episodes_equal(open_dataset(file)[0], episode)


def test_an_interrupt_while_a_folder_is_replaced_leaves_one_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "flights-v0"
    out.mkdir()
    (out / "old").touch()

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    def written() -> None:
        with replacing(out) as place:
            place.mkdir()
            (place / "new").touch()
            monkeypatch.setattr(whole.shutil, "rmtree", interrupted)

    with pytest.raises(KeyboardInterrupt):
        written()
    assert [file.name for file in out.iterdir()] == ["new"]


FULL = """
import resource, sys
from aerial_il.core.errors import StorageError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.formats import d4rl, minari, robomimic
dataset = open_dataset(sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 18, 1 << 18))
for form, out in ((robomimic, "a.hdf5"), (d4rl, "b.hdf5"), (minari, "c-v0")):
    try:
        form.write(dataset, __import__("pathlib").Path(sys.argv[2]) / out)
    except StorageError as error:
        print(error)
"""


def test_a_disk_that_fills_up_ends_with_a_word(folder: DatasetFolder, tmp_path: Path) -> None:
    """A limit on the size of files refuses as a full disk does; the process must survive it."""
    words = [sys.executable, "-c", FULL, str(folder.path), str(tmp_path)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert [Path(line.split(":")[0]).name for line in done.stdout.splitlines()] == ["a.hdf5", "b.hdf5", "c-v0"]
    assert not list(tmp_path.iterdir())
