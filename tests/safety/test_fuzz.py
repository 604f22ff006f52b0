"""A share of the mutated files of ``make fuzz``, by default; and what the table would say of a careless reader."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from aerial_il.data.formats.parts import hdf5_probe
from tests.safety import fuzz
from tests.safety.fuzz import ALL, GOOD, Target, outcomes, sound

SHARE = {"mcap": 100, "lerobot": 20, "hdf5": 8, "run": 20}


@pytest.fixture(scope="module")
def targets(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Target]:
    return sound(tmp_path_factory.mktemp("fuzz") / "sound")


@pytest.mark.parametrize("kind", ALL)
def test_a_mutated_file_is_refused_or_read_as_it_was(kind: str, targets: dict[str, Target], tmp_path: Path) -> None:
    found = Counter(said for _, said in outcomes(kind, range(SHARE[kind]), targets[kind], tmp_path))
    assert set(found) <= set(GOOD), found
    assert found["refused"]


def test_a_careless_reader_would_be_seen(targets: dict[str, Target], tmp_path: Path) -> None:
    careless = replace(targets["mcap"], read=lambda path: path.read_bytes())
    assert Counter(said for _, said in outcomes("mcap", range(5), careless, tmp_path)) == {"changed": 5}
    fragile = replace(targets["mcap"], read=lambda path: 1 // (path.name == "whole.mcap"))
    assert Counter(said for _, said in outcomes("mcap", range(2), fragile, tmp_path)) == {
        "untyped ZeroDivisionError": 2
    }


def test_a_copy_of_the_process_probes_a_file_as_a_new_one_does(
    targets: dict[str, Target], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, torn = str(targets["hdf5"].path), tmp_path / "torn.hdf5"
    torn.write_bytes(b"torn")
    assert [fuzz.comes_back(name, 0, 0) for name in (path, str(torn))] == [True, True]
    assert [hdf5_probe.comes_back(name, 0, 0) for name in (path, str(torn))] == [True, True]
    monkeypatch.setattr(hdf5_probe, "PROGRAM", "import os, signal; os.kill(os.getpid(), signal.SIGXCPU)")
    assert not fuzz.comes_back(path, 1, 0)
    assert not hdf5_probe.comes_back(path, 1, 0)


@pytest.mark.slow
@pytest.mark.parametrize("number", [368, 986])
def test_a_file_in_which_hdf5_stays_for_ever_is_refused(
    number: int, targets: dict[str, Target], tmp_path: Path
) -> None:
    """Mutations that ``make fuzz`` found: in the second, what comes before the place raises."""
    ((_, found),) = outcomes("hdf5", range(number, number + 1), targets["hdf5"], tmp_path)
    assert found == "refused"


@pytest.mark.slow
def test_a_file_of_many_demonstrations_is_not_called_damaged(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "many.hdf5", "w") as file:
        for demo in range(600):
            for name in ("actions", *(f"obs/f{i}" for i in range(10)), *(f"next_obs/f{i}" for i in range(10))):
                file[f"data/demo_{demo}/{name}"] = np.zeros((60, 3))
    hdf5_probe.require_readable(tmp_path / "many.hdf5")
