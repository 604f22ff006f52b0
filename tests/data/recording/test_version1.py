"""Recordings of schema version 1 are read, replayed and salvaged as they were."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from aerial_il.core.errors import DemoError
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.recording.writer import write_episode
from aerial_il.data.recovery import recover_episode
from aerial_il.data.replay import replay
from tests.data.crane import CraneBatch
from tests.data.recording.test_recording import ARRAYS, fly

OLD = Path(__file__).parent / "version1"  # recorded by the version of this package that wrote them
needs_their_mujoco = pytest.mark.skipif(mujoco.__version__ != "3.17.0", reason="recorded with MuJoCo 3.17.0")


@needs_their_mujoco
def test_every_value_is_what_is_flown_today() -> None:
    episode = read_episode(OLD / "plain.mcap")
    flown = fly(episode.seed, len(episode))
    for name in ARRAYS:
        ulp = 1 if name == "rewards" else 0  # numpy's exp rounds differently from processor to processor
        np.testing.assert_array_max_ulp(np.asarray(getattr(episode, name), float), np.asarray(flown[name], float), ulp)
    for name in episode.spec.observation.names:
        np.testing.assert_array_equal(episode.obs[name], flown[name], err_msg=name)
    assert episode.success
    here = replace(episode, rewards=flown["rewards"])
    assert replay(CraneBatch(4), here, starts=range(0, len(episode), 5)) > 0


def test_images_and_extras_are_read_and_written_anew_equal(tmp_path: Path) -> None:
    old = read_episode(OLD / "filmed.mcap", cameras=True)
    assert old.obs["scene_rgb"].shape == (71, 24, 32, 3)
    np.testing.assert_array_equal(old.extras["device"], [[0.1 * k, k % 2] for k in range(70)])
    assert old.extra_labels == {"device": ("stick", "button")}
    new = read_episode(write_episode(old, tmp_path / "new.mcap"))
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(new, name), getattr(old, name), err_msg=name)
    for name in old.spec.observation.state_names:
        np.testing.assert_array_equal(new.obs[name], old.obs[name], err_msg=name)
    assert (new.uid, new.provenance, new.success) == (old.uid, old.provenance, old.success)
    np.testing.assert_array_equal(new.extras["device"], old.extras["device"])


def test_what_a_kill_left_is_salvaged(tmp_path: Path) -> None:
    whole, raw = read_episode(OLD / "filmed.mcap"), (OLD / "filmed.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(raw[: int(0.9 * len(raw))])
    saved = recover_episode(tmp_path / "cut.mcap", tmp_path / "saved.mcap")
    assert saved.steps == 63
    np.testing.assert_array_equal(read_episode(saved.path).states, whole.states[:64])


def test_a_flipped_bit_is_found(tmp_path: Path) -> None:
    raw = bytearray((OLD / "plain.mcap").read_bytes())
    raw[len(raw) // 2] ^= 1
    (tmp_path / "flipped.mcap").write_bytes(raw)
    with pytest.raises(DemoError, match=r"malformed record|checksum"):
        read_episode(tmp_path / "flipped.mcap")
