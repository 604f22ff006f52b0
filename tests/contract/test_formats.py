"""Every registered format: it knows its own and nobody else's, gives back what it wrote, and fails by a typed error."""

from __future__ import annotations

import inspect
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import h5py
import numpy as np
import pytest

from aerial_il.collection.collect import collect
from aerial_il.core import registry
from aerial_il.core.errors import AerialError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from aerial_il.data.formats import find
from tests.data.crane import CraneBatch, CraneExpert

NAMES = registry.names("format")
each = pytest.mark.parametrize("name", NAMES)
FLOAT32 = 1e-6  # of d4rl's numbers


def as_npz(episodes: list[Episode], place: Path) -> Path:
    arrays = {
        "obs": np.concatenate([e.flat_obs(e.spec.observation.state_names)[:-1] for e in episodes]),
        "next_obs": np.concatenate([e.flat_obs(e.spec.observation.state_names)[1:] for e in episodes]),
        "acts": np.concatenate([e.labels for e in episodes]),
        "rews": np.concatenate([e.rewards for e in episodes]),
        "truncations": np.concatenate([np.arange(len(e)) == len(e) - 1 for e in episodes]),
    }
    np.savez(place / "transitions.npz", **arrays)
    return place / "transitions.npz"


def as_aloha(episodes: list[Episode], place: Path) -> Path:
    for number, episode in enumerate(episodes):
        with h5py.File(place / f"episode_{number}.hdf5", "w") as file:
            file["observations/qpos"] = episode.flat_obs(episode.spec.observation.state_names)[:-1]
            file["action"] = episode.labels
    return place


SAMPLES: dict[str, Callable[[list[Episode], Path], Path]] = {"npz": as_npz, "aloha": as_aloha}  # of those not written
UNREWARDED = "aloha"
RECORDED = "recording"  # its sample is what the others are made of


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return collect(
        CraneBatch(3), CraneExpert(), range(5), tmp_path_factory.mktemp("recorded"), progress=False
    ).folder.path


@pytest.fixture(scope="module")
def samples(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Path]:
    home, episodes = tmp_path_factory.mktemp("samples"), list(open_dataset(recorded))
    return {name: sample(name, episodes, home) for name in NAMES if name != RECORDED} | {RECORDED: recorded}


def sample(name: str, episodes: list[Episode], home: Path) -> Path:
    """Return what a format writes, or what SAMPLES say that it reads."""
    form, place = registry.module("format", name), home / name
    place.mkdir()
    return SAMPLES[name](episodes, place) if name in SAMPLES else form.write(episodes, place / form.OWN_NAME)


@each
def test_it_defines_what_a_format_must(name: str) -> None:
    form = registry.module("format", name)
    assert form.__doc__
    assert list(inspect.signature(form.recognises).parameters) == ["path"]
    assert list(inspect.signature(form.read).parameters) == ["path", "wanted"]
    if hasattr(form, "write"):
        assert list(inspect.signature(form.write).parameters) == ["episodes", "out", "env_spec"]
        assert form.ENDINGS
        assert Path(form.OWN_NAME).suffix in form.ENDINGS


@each
def test_it_recognises_its_own_and_no_other_does(name: str, samples: Mapping[str, Path]) -> None:
    others = [other for other in NAMES if registry.module("format", other).recognises(samples[name])]
    assert others == [name]
    assert find(samples[name]) is registry.module("format", name)


@each
def test_what_was_written_reads_back_equal(name: str, recorded: Path, samples: Mapping[str, Path]) -> None:
    assert_equal(samples[name], list(open_dataset(recorded)), rewarded=name != UNREWARDED)


def assert_equal(path: Path, episodes: list[Episode], *, rewarded: bool = True) -> None:
    back = open_dataset(path)
    assert len(back) == len(episodes)
    for mine, theirs in zip(back, episodes, strict=True):
        steps = len(theirs)
        seen, shown = (e.flat_obs(e.spec.observation.state_names)[:steps] for e in (mine, theirs))
        np.testing.assert_allclose(seen, shown, rtol=FLOAT32, atol=FLOAT32)
        np.testing.assert_allclose(mine.actions, theirs.labels, rtol=FLOAT32)
        np.testing.assert_allclose(mine.rewards, theirs.rewards * rewarded, rtol=FLOAT32)
        assert mine.success == theirs.success
        assert len(mine.sim_time) == len(mine.states) == steps + 1
        assert not mine.spec.differences(back.spec)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
@pytest.mark.parametrize("damage", ["cut", "garbage"])
@each
def test_damage_is_a_typed_error(
    name: str, damage: str, share: float, samples: Mapping[str, Path], tmp_path: Path
) -> None:
    assert_damage_is_told(samples[name], damage, share, tmp_path)


def assert_damage_is_told(sample: Path, damage: str, share: float, scratch: Path) -> None:
    """Require an error of ours for a sample all of whose files are cut, or garbage from some place on."""
    copy = scratch / sample.name
    shutil.copytree(sample, copy) if sample.is_dir() else shutil.copyfile(sample, copy)
    rng = np.random.default_rng(len(damage))
    for file in [copy] if copy.is_file() else [f for f in copy.rglob("*") if f.is_file()]:
        raw = file.read_bytes()
        kept, lost = raw[: int(share * len(raw))], len(raw) - int(share * len(raw))
        file.write_bytes(kept if damage == "cut" else kept + rng.bytes(lost))
    try:
        list(open_dataset(copy))
    except AerialError:
        return
    assert damage == "garbage", "cut, and not noticed"
    assert share, "garbage, and not noticed"  # garbage among numbers is numbers where a format keeps no checksums
