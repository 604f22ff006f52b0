"""Compiled code is never older than what it was compiled from."""

from __future__ import annotations

from pathlib import Path

import numba
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
