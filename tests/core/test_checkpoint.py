"""A sealed folder comes back exactly, or is refused by name."""

import json
import logging
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from aerial_il.core import checkpoint as ckpt
from aerial_il.core.errors import CheckpointError


def example(step: int = 7) -> ckpt.Checkpoint:
    rng = np.random.default_rng(step)
    arrays = {"w": rng.normal(size=(5, 3)).astype(np.float32), "step": np.asarray(step), "t": rng.normal(size=4)}
    return ckpt.Checkpoint(arrays, {"step": step, "rng": "00ff", "loss": 0.1 + step}, {"policy": {"lr": 1e-5}})


def test_round_trip_is_exact(tmp_path: Path) -> None:
    saved = example()
    loaded = ckpt.load(ckpt.save(tmp_path / "a", saved))
    assert loaded.arrays.keys() == saved.arrays.keys()
    for name, array in saved.arrays.items():
        assert loaded.arrays[name].dtype == array.dtype
        np.testing.assert_array_equal(loaded.arrays[name], array)
    assert (loaded.state, loaded.config) == (saved.state, saved.config)


def test_saving_again_replaces(tmp_path: Path) -> None:
    for step in (1, 2):
        ckpt.save(tmp_path / "a", example(step))
    assert ckpt.load(tmp_path / "a").state["step"] == 2
    assert os.listdir(tmp_path) == ["a"]


@pytest.mark.parametrize("name", [ckpt.ARRAYS, ckpt.STATE, ckpt.CONFIG, ckpt.MANIFEST])
def test_every_flipped_byte_and_every_cut_is_refused(tmp_path: Path, name: str) -> None:
    path = ckpt.save(tmp_path / "a", example()) / name
    whole = path.read_bytes()
    for i in range(0, len(whole), max(1, len(whole) // 150)):
        path.write_bytes(whole[:i] + bytes([whole[i] ^ (1 << i % 8)]) + whole[i + 1 :])
        with pytest.raises(CheckpointError, match=str(tmp_path)):
            ckpt.load(tmp_path / "a")
        path.write_bytes(whole[:i])
        with pytest.raises(CheckpointError) as caught:
            ckpt.load(tmp_path / "a")
        assert name in caught.value.path
    path.write_bytes(whole)
    ckpt.load(tmp_path / "a")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    folder = ckpt.save(tmp_path / "a", example())
    (folder / ckpt.STATE).unlink()
    with pytest.raises(CheckpointError, match=ckpt.STATE):
        ckpt.load(folder)


def test_another_version_is_refused_with_both_numbers(tmp_path: Path) -> None:
    folder = ckpt.save(tmp_path / "a", example())
    manifest = json.loads((folder / ckpt.MANIFEST).read_text())
    (folder / ckpt.MANIFEST).write_text(json.dumps({**manifest, "version": 99}))
    with pytest.raises(CheckpointError, match="version 99; this release reads 1"):
        ckpt.load(folder)


def test_latest_passes_over_damage_and_says_so(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert ckpt.latest(tmp_path) is None
    for step in (5, 10):
        ckpt.save(ckpt.step_folder(tmp_path, step), example(step))
    arrays = ckpt.step_folder(tmp_path, 10) / ckpt.ARRAYS
    arrays.write_bytes(arrays.read_bytes()[:-1])
    with caplog.at_level(logging.WARNING):
        result = ckpt.latest(tmp_path)
    assert result is not None
    assert result[1].state["step"] == 5
    assert str(arrays) in caplog.text
    (ckpt.step_folder(tmp_path, 5) / ckpt.CONFIG).unlink()
    with pytest.raises(CheckpointError, match="No other checkpoint is valid"):
        ckpt.latest(tmp_path)


def test_checkpoints_of_another_version_may_be_kept(tmp_path: Path) -> None:
    folder = ckpt.save(ckpt.step_folder(tmp_path, 5), example(5))
    manifest = json.loads((folder / ckpt.MANIFEST).read_text())
    (folder / ckpt.MANIFEST).write_text(json.dumps({**manifest, "version": 99}))
    with pytest.raises(CheckpointError, match=r"the release of aerial_il that wrote it\. Delete"):
        ckpt.latest(tmp_path)


def test_prune_keeps_the_newest_and_sweeps_leftovers(tmp_path: Path) -> None:
    for step in (1, 2, 3, 10):
        ckpt.save(ckpt.step_folder(tmp_path, step), example(step))
    (tmp_path / ckpt.FOLDER / ".00000011.123.tmp").mkdir()
    ckpt.prune(tmp_path, keep=2)
    assert sorted(os.listdir(tmp_path / ckpt.FOLDER)) == ["00000003", "00000010"]


def test_a_full_disk_leaves_the_last_checkpoint_readable(tmp_path: Path) -> None:
    """A file size limit makes the kernel refuse the write, as a full disk does."""
    ckpt.save(ckpt.step_folder(tmp_path, 1), example(1))
    script = """
        import resource, sys, numpy as np
        from aerial_il.core import checkpoint as ckpt
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
        ckpt.save(ckpt.step_folder(sys.argv[1], 2), ckpt.Checkpoint({"w": np.zeros(100_000)}))
    """
    command = [sys.executable, "-c", textwrap.dedent(script), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "CheckpointError" in done.stderr
    assert "cannot be written" in done.stderr
    assert os.listdir(tmp_path / ckpt.FOLDER) == ["00000001"]
    result = ckpt.latest(tmp_path)
    assert result is not None
    assert result[1].state["step"] == 1


def test_a_pickle_is_refused(tmp_path: Path) -> None:
    import pickle

    folder = ckpt.save(tmp_path / "a", example())
    (folder / ckpt.ARRAYS).write_bytes(pickle.dumps({"w": 1}))
    with pytest.raises(CheckpointError):
        ckpt.load(folder)
