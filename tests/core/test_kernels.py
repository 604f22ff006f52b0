"""Compiled code is never older than its source, and torch does not depend on where numpy put its numbers."""

import ast
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from aerial_il.core import kernels, rotations
from aerial_il.core.tensors import tensor

stamp_of_all = kernels._kernel_sources  # what is stamped is seen nowhere else: numba keeps it beside its version


def stamp(compiled: Any) -> str:
    """What the cached code of a function is valid for."""
    return compiled._cache._cache_file._version


def test_the_cache_is_stamped_with_all_sources() -> None:
    assert stamp(numba.njit(cache=True)(lambda x: x)) == numba.__version__
    assert stamp(rotations.add) == f"{numba.__version__} {stamp_of_all()}"


def test_a_first_compilation_is_announced_once(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(
        "import logging\nfrom aerial_il.core.kernels import kernel\nlogging.basicConfig(level=logging.INFO)\n"
        "one = kernel(lambda x: x + 1)\ntwo = kernel(lambda x: x + 2)\nprint(one(1), two(1))\n"
    )
    cache = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    told = [
        subprocess.run([sys.executable, "own.py"], cwd=tmp_path, env=cache, capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    assert [done.stdout for done in told] == ["2 3\n"] * 2
    assert [done.stderr.count("Compiling what flies here") for done in told] == [1, 0]


def test_an_edit_of_any_file_that_kernels_use_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    counted = ("core/rotations.py", "control/flight.py", "suite/timing.py", "suite/physics/world.py")
    for name in ("core/kernels.py", "core/errors.py", "suite/tiers.py", *counted):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_text("@kernel\n" if name == "core/rotations.py" else "x = 1\n")
    monkeypatch.setattr(kernels, "PACKAGE", tmp_path)
    stamps = [stamp_of_all.__wrapped__()]
    for name in (*counted, "core/errors.py"):
        with (tmp_path / name).open("a") as file:
            file.write("y = 2\n")
        stamps.append(stamp_of_all.__wrapped__())
    assert len(set(stamps[:5])) == 5
    assert stamps[5] == stamps[4], "a file without kernels costs no compilation"


def test_the_stamp_counts_every_file_that_kernels_use() -> None:
    package, stamped = kernels.PACKAGE, kernels._kernel_files()
    taken = 0
    for layer in ("core", "control", "suite", "experts"):
        for path in (package / layer).rglob("*.py"):
            used = _taken_by_kernels(path)
            taken += len(used)
            own = kernels.CALLED.get(path.parent.relative_to(package).as_posix(), ())
            missing = used - stamped - {file for folder in own for file in (package / folder).glob("*.py")}
            assert not missing, f"{path} compiles what these hold: {missing}"
    assert taken > 100


def _taken_by_kernels(path: Path) -> set[Path]:
    """Files of the package that kernels of a module, if it has any, take kernels and constants from."""
    body = ast.parse(path.read_text(encoding="utf-8")).body
    compiled = [node for node in body if isinstance(node, ast.FunctionDef) and _is_kernel(node)]
    names = {part.id for node in compiled for part in ast.walk(node) if isinstance(part, ast.Name)} - {"kernel"}
    imported = (
        node for node in body if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("aerial_il")
    )
    return {_file(node.module or "", a.name) for node in imported for a in node.names if (a.asname or a.name) in names}


def _is_kernel(function: ast.FunctionDef) -> bool:
    return any(isinstance(mark, ast.Name) and mark.id == "kernel" for mark in function.decorator_list)


def _file(module: str, name: str) -> Path:
    folder = kernels.PACKAGE.parent.joinpath(*module.split("."))
    candidates = (folder / f"{name}.py", folder.with_suffix(".py"), folder / "__init__.py")
    return next(path for path in candidates if path.exists())


@kernels.kernel
def _add_up(pair, result):
    result[0] = pair.first.sum() + pair.second


class _Pair(NamedTuple):
    first: np.ndarray
    second: float


def test_an_entry_is_the_kernel_for_the_types_it_was_made_for() -> None:
    result, pair = np.zeros(1), _Pair(np.arange(3.0), 4.0)
    entry = kernels.entry_of(_add_up, pair, result)
    assert result[0] == 0.0, "making it runs nothing"
    entry(_Pair(np.arange(5.0), 0.5), result)
    assert result[0] == 10.5
    with pytest.raises(TypeError):
        entry(_Pair(np.arange(3, dtype=np.float32), 4.0), result)


def test_a_kernel_elsewhere_is_stale_with_the_files_beside_it(tmp_path: Path) -> None:
    (tmp_path / "one.py").write_text("def read(found):\n    found[0] = 1.0\n")
    defined: dict[str, Callable[..., Any]] = {}
    exec(compile((tmp_path / "one.py").read_text(), str(tmp_path / "one.py"), "exec"), defined)
    stamps = []
    for text in ("HELP = 1\n", "HELP = 2\n"):
        (tmp_path / "beside.py").write_text(text)
        kernels._folder_sources.cache_clear()
        stamps.append(stamp(kernels.kernel(defined["read"])))
    assert stamps[0] != stamps[1]


@pytest.mark.parametrize("offset", [0, 4, 16, 52])
def test_a_tensor_begins_at_a_cache_line(offset: int) -> None:
    memory = np.zeros(400, np.uint8)
    start = -memory.ctypes.data % 64 + offset
    array = memory[start : start + 240].view(np.float32).reshape(15, 4)
    copied = tensor(array)
    array += 1.0
    assert copied.data_ptr() % 64 == 0
    assert (copied == 0.0).all()
