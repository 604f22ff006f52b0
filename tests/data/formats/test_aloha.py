"""ALOHA's HDF5 files open with every value, train, and are checked like all others."""

import io
from pathlib import Path

import h5py
import numpy as np
import pytest
from PIL import Image

import aerial_il
from aerial_il.cli.main import main
from aerial_il.core.errors import DemoError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.formats import aloha, find
from tests.examples import plugged_in

STEPS = (25, 30)
SIZE = (24, 32, 3)


def write(place: Path, *, compress: bool = False) -> Path:
    """Write a folder of demonstrations as ALOHA's ``record_episodes`` does."""
    place.mkdir(exist_ok=True)
    for number, steps in enumerate(STEPS):
        rng = np.random.default_rng(number)
        with h5py.File(place / f"episode_{number}.hdf5", "w") as file:
            file.attrs["sim"], file.attrs["compress"] = True, compress
            for name in ("qpos", "qvel"):
                file[f"observations/{name}"] = rng.normal(size=(steps, 14)).astype("f4")
            pictures = rng.integers(0, 255, (steps, *SIZE), np.uint8)
            file["observations/images/top"] = jpegs(pictures) if compress else pictures
            file["action"] = rng.normal(size=(steps, 14)).astype("f4")
    return place


def jpegs(pictures: np.ndarray) -> np.ndarray:
    coded = []
    for picture in pictures:
        Image.fromarray(picture).save(buffer := io.BytesIO(), "JPEG")
        coded.append(np.frombuffer(buffer.getvalue(), np.uint8))
    longest = max(map(len, coded))
    return np.stack([np.pad(code, (0, longest - len(code))) for code in coded])


def test_one_file_is_a_dataset_of_one(tmp_path: Path) -> None:
    assert open_dataset(write(tmp_path / "demos") / "episode_1.hdf5").uids == ("episode_1",)


@pytest.mark.parametrize("compress", [False, True])
def test_every_value_is_read(compress: bool, tmp_path: Path) -> None:
    dataset = open_dataset(write(tmp_path / "demos", compress=compress), cameras=True)
    assert dataset.uids == ("episode_0", "episode_1")
    assert dataset.spec.control_dt_s == 0.02
    with h5py.File(dataset.path / "episode_1.hdf5") as file:
        np.testing.assert_array_equal(dataset[1].actions, file["action"])
        np.testing.assert_array_equal(dataset[1].obs["qpos"][:-1], file["observations/qpos"])
        if not compress:
            np.testing.assert_array_equal(dataset[1].obs["top_rgb"][:-1], file["observations/images/top"])
    assert dataset[1].obs["top_rgb"].shape == (STEPS[1] + 1, *SIZE)
    assert "top_rgb" not in open_dataset(dataset.path)[0].obs


def test_the_commands_take_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "demos")
    assert main(["info", "demos"]) == 0
    assert "2 episodes, 2 successful" in capsys.readouterr().out
    assert main(["validate", "demos", "progress=false"]) == 0
    small = ["policy.hidden=[8]", "policy.chunk=2", "algorithm.steps=2", "algorithm.validate_every=0"]
    assert main(["train", "dataset=demos", "run=run", *small, "progress=false"]) == 0
    assert aerial_il.load_policy("run").spec.action.size == 14


def test_what_is_wrong_with_it_is_said_by_the_gate(tmp_path: Path) -> None:
    folder = write(tmp_path / "demos")
    with h5py.File(folder / "episode_1.hdf5", "a") as file:
        file["action"][3, 2] = np.nan
    with pytest.raises(DemoError, match=r"episode_1 has a value that is not finite.*step 3, field actions\[2\]"):
        open_dataset(folder, strict=True)


def test_two_formats_that_know_one_file_are_named(tmp_path: Path) -> None:
    """One of them from a package that is installed beside ours."""
    folder = write(tmp_path / "demos")
    (tmp_path / "twin.py").write_text(Path(aloha.__file__).read_text())
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(tmp_path))
        with (
            plugged_in({"format": {"twin": "twin"}}),
            pytest.raises(DemoError, match="recognised by several formats: aloha, twin"),
        ):
            find(folder)
