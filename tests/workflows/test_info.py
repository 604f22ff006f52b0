"""What a dataset holds is said without reading its recordings again."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from aerial_il.cli.main import main
from aerial_il.collection.collect import collect
from aerial_il.data import dataset as opened
from aerial_il.data.table import CACHE
from aerial_il.workflows.collect import Collect
from aerial_il.workflows.collect import collect as record_as_typed
from aerial_il.workflows.info import Info, info
from experiments.foreign import layouts
from tests.data.crane import CraneBatch, CraneExpert


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cranes")
    return collect(CraneBatch(3), CraneExpert(), range(4), folder, progress=False).folder.path


@pytest.fixture
def folder(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "copy"))


def count_of_reads(folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[list[dict], int]:
    """Return what is said of the episodes, and how many were read for it."""
    read, before = [], opened.Dataset._read_ahead

    def counted(self: opened.Dataset):
        read.extend(self.uids)
        return before(self)

    with monkeypatch.context() as patch:
        patch.setattr(opened.Dataset, "_read_ahead", counted)
        return info(Info(path=str(folder)))["episodes"], len(read)


def test_only_what_changed_is_read_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, read = count_of_reads(folder, monkeypatch)
    assert read == len(first) == 4
    assert count_of_reads(folder, monkeypatch) == (first, 0)
    victim = next((folder / "demos").glob("*.mcap"))
    victim.write_bytes(victim.read_bytes())
    assert count_of_reads(folder, monkeypatch) == (first, 1)


def test_what_was_just_recorded_is_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def record(episodes: int) -> None:
        keys = {"episodes": episodes, "out": str(tmp_path / "hover"), "tier": "gusts", "horizon": 30, "progress": False}
        record_as_typed(Collect(robot="quad", task="hover", **keys))

    record(3)
    known, read = count_of_reads(tmp_path / "hover", monkeypatch)
    assert (len(known), read) == (3, 0)
    (tmp_path / "hover" / CACHE).unlink()
    assert count_of_reads(tmp_path / "hover", monkeypatch) == (known, 3), "the recordings say the same"
    record(5)
    assert count_of_reads(tmp_path / "hover", monkeypatch)[1] == 0


@pytest.mark.parametrize("text", ["", "{}", '{"a": 1}', "[1, 2]"])
def test_a_file_that_is_none_of_ours_is_neither_believed_nor_overwritten(
    text: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said, _ = count_of_reads(folder, monkeypatch)
    (folder / CACHE).write_text(text)
    assert count_of_reads(folder, monkeypatch)[0] == said
    assert (folder / CACHE).read_text() == text


PATHS = [np.arange(10 * k, 10 * k + 9)[:, None] * [0.1, 0.2] for k in range(3)]
LAST, PULLED = np.arange(8) == 7, np.ones((8, 1), "f4")
FLAT = {
    "observations": np.concatenate([path[:-1] for path in PATHS]), "actions": np.tile(PULLED, (3, 1)),
    "timeouts": np.tile(LAST, 3),
}  # fmt: skip
BUFFER = {"actions": PULLED, "rewards": np.zeros(8), "terminations": ~LAST & LAST, "truncations": LAST}
STATES = [{"observation.state": path[:-1], "action": PULLED} for path in PATHS]
FOREIGN: dict[str, tuple[str, Callable[[Path], Path], str, int]] = {  # format -> name, writer, environment, rate
    "npz": ("a.npz", lambda at: layouts.npz(at, FLAT), "npz", 1),
    "d4rl": ("a.hdf5", lambda at: layouts.d4rl(at, FLAT), "d4rl", 1),
    "robomimic": (
        "a.hdf5",
        lambda at: layouts.robomimic(at, *({"obs": {"arm": path[:-1]}, "actions": PULLED} for path in PATHS)),
        "robomimic, Lift",
        20,
    ),
    "minari": (
        "a-v0",
        lambda at: layouts.minari(at, *({"observations": path, **BUFFER} for path in PATHS)),
        "minari",
        1,
    ),
    "lerobot": (
        "a",
        lambda at: layouts.lerobot(at, *STATES, fps=30, robot_type="crane", task="Pull."),
        "lerobot, crane. Pull",
        30,
    ),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_files_of_others_are_described(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    place, write, where, rate = FOREIGN[name]
    write(Path(place))
    assert main(["info", place]) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"{place}: {where}.")
    assert f"3 episodes, 3 successful, {24 / rate:.0f} s of flight: 24 steps at {rate} Hz" in said
    assert main(["info", place, "json=true"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["format"], told["foreign"], told["control_dt_s"]) == (name, True, pytest.approx(1 / rate))
    assert [field["shape"] for field in told["fields"]] == [[2]]
