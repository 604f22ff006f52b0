"""What is trained on takes no more memory than it may, and is the same wherever it lies."""

import logging
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aerial_il.core.errors import StorageError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.memory import MEMORY
from aerial_il.data.windows import Windows

MEGABYTE = 1 << 20


@pytest.fixture(scope="module")
def episodes(folder: DatasetFolder) -> list[Episode]:
    return list(open_dataset(folder.path, failures=True))


def in_file(array: np.ndarray) -> bool:
    while isinstance(array.base, np.ndarray):
        array = array.base
    return not array.flags.owndata


def test_beyond_the_limit_arrays_lie_in_files_and_it_is_said(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO), MEMORY.limited(100):
        first = MEMORY.empty((80 * MEGABYTE,), np.uint8)
        second = MEMORY.empty((20, MEGABYTE), np.float64)
        second[...] = 7.0
    assert (in_file(first), in_file(second)) == (False, True)
    assert (second == 7.0).all()
    assert "100 MB of memory (dataset.held_mb=N for more)" in caplog.text


def test_memory_that_is_given_back_is_used_again() -> None:
    with MEMORY.limited(100):
        for _ in range(5):
            assert not in_file(MEMORY.empty((80 * MEGABYTE,), np.uint8))


def test_windows_are_the_same_in_files(episodes: list[Episode]) -> None:
    names = episodes[0].spec.observation.state_names
    here = Windows(episodes, names, history=2, chunk=5, successes_only=False)
    with MEMORY.limited(0):
        kept = [MEMORY.keep(episode) for episode in episodes]
        there = Windows(kept, names, history=2, chunk=5, successes_only=False)
    assert all(in_file(episode.actions) for episode in kept)
    for mine, theirs in zip(here[np.arange(len(here))], there[np.arange(len(there))], strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_an_array_that_an_episode_holds_twice_is_kept_once(episodes: list[Episode]) -> None:
    kept = MEMORY.keep(replace(episodes[0], executed_actions=episodes[0].actions))
    assert kept.executed_actions is kept.actions
    np.testing.assert_array_equal(kept.actions, episodes[0].actions)


def test_a_place_without_room_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path / "nowhere"))
    with MEMORY.limited(0), pytest.raises(StorageError, match=r"nowhere.*TMPDIR"):
        MEMORY.empty((9,), np.float64)


def test_each_episode_keeps_its_own_provenance(episodes: list[Episode]) -> None:
    told = [{"git": None}, {"git": None, "seed": 1}, {"seed": 1}, {"git": {"sha": "a"}, "seed": 2}]
    kept = [MEMORY.keep(replace(episodes[0], provenance=each)) for each in told]
    assert [episode.provenance for episode in kept] == told


def test_a_place_that_is_missing_matters_only_when_needed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path / "nowhere"))
    with MEMORY.limited(100):
        assert 0 < MEMORY.room_bytes() <= 100 * MEGABYTE


def test_large_arrays_share_files() -> None:
    before = len(os.listdir("/proc/self/fd"))
    with MEMORY.limited(0):
        kept = [MEMORY.empty((20 * MEGABYTE,), np.uint8) for _ in range(40)]
    assert len(os.listdir("/proc/self/fd")) - before < 12
    del kept
    assert len(os.listdir("/proc/self/fd")) == before
