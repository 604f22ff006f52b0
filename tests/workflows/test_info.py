"""What a dataset holds is said without reading its recordings again."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from aerial_il.collection.collect import collect
from aerial_il.data import dataset as opened
from aerial_il.data.table import CACHE
from aerial_il.workflows.collect import Collect
from aerial_il.workflows.collect import collect as record_as_typed
from aerial_il.workflows.info import Info, info
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
