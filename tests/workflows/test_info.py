"""What a dataset holds is said without reading its recordings again."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from aerial_il.collection.collect import collect
from aerial_il.data import dataset as opened
from aerial_il.workflows.info import CACHE, Info, info
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


@pytest.mark.parametrize("text", ["", "{}", '{"a": 1}', "[1, 2]"])
def test_a_file_that_is_none_of_ours_is_neither_believed_nor_overwritten(
    text: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said, _ = count_of_reads(folder, monkeypatch)
    (folder / CACHE).write_text(text)
    assert count_of_reads(folder, monkeypatch)[0] == said
    assert (folder / CACHE).read_text() == text
