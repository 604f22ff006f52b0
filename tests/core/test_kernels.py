"""Compiled code is never older than what it was compiled from."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest

from aerial_il.core import kernels, rotations


def test_the_cache_is_stamped_with_all_sources() -> None:
    plain = numba.njit(cache=True)(lambda x: x)
    assert plain._cache._cache_file._version == numba.__version__, "numba keeps its version where kernel() adds to it"
    assert rotations.add._cache._cache_file._version == f"{numba.__version__} {kernels._kernel_sources()}"


def test_an_edit_of_any_file_that_kernels_use_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("core/kernels.py", "core/rotations.py", "core/errors.py", "control/flight.py", "suite/memory.py"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("@kernel\n" if name == "core/rotations.py" else "x = 1\n")
    monkeypatch.setattr(kernels, "PACKAGE", tmp_path)
    stamps = [kernels._kernel_sources.__wrapped__()]
    for name in ("core/rotations.py", "control/flight.py", "suite/memory.py", "core/errors.py"):
        with (tmp_path / name).open("a") as file:
            file.write("y = 2\n")
        stamps.append(kernels._kernel_sources.__wrapped__())
    assert len(set(stamps[:4])) == 4
    assert stamps[4] == stamps[3], "a file without kernels costs no compilation"


@kernels.kernel
def _add_up(pair, found):
    found[0] = pair.first.sum() + pair.second


class _Pair(NamedTuple):
    first: np.ndarray
    second: float


def test_an_entry_is_the_kernel_for_the_types_it_was_made_for() -> None:
    found, pair = np.zeros(1), _Pair(np.arange(3.0), 4.0)
    entry = kernels.entry_of(_add_up, pair, found)
    assert found[0] == 0.0, "making it runs nothing"
    entry(_Pair(np.arange(5.0), 0.5), found)
    assert found[0] == 10.5
    with pytest.raises(TypeError):
        entry(_Pair(np.arange(3, dtype=np.float32), 4.0), found)
