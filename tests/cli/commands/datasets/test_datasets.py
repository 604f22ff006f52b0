"""Commands on datasets: the ending of ``out`` chooses the format; a dataset, folders and files are judged alike."""

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from aerial_il.cli.main import main
from aerial_il.data.dataset import open_dataset

QUIET = "progress=false"


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("convert")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["collect", "task=reach", "episodes=2", "out=demos", QUIET]) == 0
    return folder


@pytest.fixture(autouse=True)
def at_home(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(home)


@pytest.mark.parametrize(
    ("words", "made"), [(["out=a.hdf5"], "a.hdf5"), (["format=robomimic"], "demos/derived/robomimic.hdf5")]
)
def test_an_hdf5_is_robomimic_s(words: list[str], made: str) -> None:
    assert main(["convert", "demos", *words, QUIET]) == 0
    back, recorded = open_dataset(made), open_dataset("demos")
    assert back.uids == recorded.uids
    np.testing.assert_array_equal(back[0].states, recorded[0].states)


def test_d4rl_s_is_flat() -> None:
    assert main(["convert", "demos", "format=d4rl", "out=flat.hdf5", QUIET]) == 0
    recorded = open_dataset("demos")
    with h5py.File("flat.hdf5") as raw:
        assert set(raw) == {
            "observations",
            "next_observations",
            "actions",
            "rewards",
            "terminals",
            "timeouts",
            "metadata",
        }
        assert np.flatnonzero(raw["terminals"][()] | raw["timeouts"][()]).tolist() == [
            len(recorded[0]) - 1, len(recorded[0]) + len(recorded[1]) - 1,
        ]  # fmt: skip
    back = open_dataset("flat.hdf5")
    np.testing.assert_allclose(back[1].actions, recorded[1].labels, rtol=1e-6)
    names = recorded.spec.observation.state_names
    np.testing.assert_allclose(back[1].obs["observation"], recorded[1].flat_obs(names), rtol=1e-5, atol=1e-6)
    assert main(["train", "dataset=flat.hdf5", "run=run", "algorithm.steps=2", "policy.hidden=[8]", QUIET]) == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["out=a.rrd", "format=robomimic"], "its name must end in .hdf5 or .h5"),
        (["out=a.hdf5", "format=lerobot"], "in no ending of another format"),
        (["out=folder", "format=rrd"], "its name must end in .rrd"),
        (["format=tfrecord"], "is not one of lerobot, robomimic, d4rl, minari, rrd, mcap"),
    ],
)
def test_an_ending_of_another_format_is_refused(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["convert", "demos", *words, QUIET]) == 2
    assert said in capsys.readouterr().err


@pytest.fixture
def demos(tmp_path: Path) -> Path:
    words = ["env=gymnasium:CartPole-v1", "policy=random", "success=survived", "max_steps=3", "episodes=2"]
    assert main(["collect", *words, f"out={tmp_path / 'all' / 'flown'}", QUIET]) == 0
    return tmp_path / "all" / "flown"


def test_a_sound_file_is_sound_wherever_it_lies(demos: Path, tmp_path: Path) -> None:
    file = next(demos.glob("demos/*.mcap"))
    away = Path(shutil.copy(file, tmp_path / "away.mcap"))
    for place in (file, away, demos, demos.parent):
        assert main(["validate", str(place), QUIET]) == 0


def test_a_sound_file_that_is_not_the_one_listed_is_told(demos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, other = sorted(demos.glob("demos/*.mcap"))
    shutil.copy(other, file)
    for place in (file, demos, demos.parent):
        assert main(["validate", str(place), QUIET]) == 2
        assert "differs from what the index lists" in capsys.readouterr().out
    assert main(["validate", str(other), QUIET]) == 0


def test_a_damaged_file_is_told(demos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = next(demos.glob("demos/*.mcap"))
    file.write_bytes(file.read_bytes()[:-100])
    assert main(["validate", str(file), QUIET]) == 2
    assert "aerial-il recover" in capsys.readouterr().err
