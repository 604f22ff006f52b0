"""A probe of whether the HDF5 library returns from a file at all: in some damaged ones it loops for ever.

So a process of its own, with little time and memory, reads all attributes and the ends of all datasets first.
"""

from __future__ import annotations

import os
import subprocess
import sys
from functools import lru_cache
from pathlib import Path

from aerial_il.core.errors import DemoError

MAX_S, MAX_BYTES = 3, 2 << 30
_READ = f"""
import resource, sys
resource.setrlimit(resource.RLIMIT_CPU, ({MAX_S}, {MAX_S}))
resource.setrlimit(resource.RLIMIT_AS, ({MAX_BYTES}, {MAX_BYTES}))
import h5py
def visit(name, item):
    try:
        dict(item.attrs)
        if isinstance(item, h5py.Dataset) and item.shape and not (item.external or item.is_virtual):
            item[:1], item[-1:]
    except Exception:
        pass
try:
    with h5py.File(sys.argv[1], "r") as file:
        visit("/", file)
        file.visititems(visit)
except Exception:
    pass
"""


def require_readable(path: Path) -> None:
    """Refuse a file in which the library stays, or dies; whatever else is wrong with it, its reader says.

    Raises:
        DemoError: it would not have come back.
    """
    found = path.stat()
    if not _comes_back(str(path), found.st_mtime_ns, found.st_size):
        raise DemoError(path, f"is damaged: the HDF5 library does not come back from it within {MAX_S} s.")


@lru_cache(maxsize=64)
def _comes_back(path: str, changed_ns: int, size: int) -> bool:
    words = [sys.executable, "-I", "-c", _READ, os.path.abspath(path)]
    try:
        return subprocess.run(words, capture_output=True, timeout=12 * MAX_S, check=False).returncode >= 0
    except subprocess.TimeoutExpired:
        return False
