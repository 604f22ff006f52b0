"""A probe of whether the HDF5 library returns from a file at all: in some damaged ones it loops for ever.

So a process of its own, with little memory and processor time, opens all objects and reads their attributes and the
ends of their data first; each by itself, as one that raises says nothing of the next. Time on the clock decides
nothing: on a busy computer a sound file may take long.
"""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
from functools import lru_cache
from pathlib import Path

from aerial_il.core.errors import DemoError

MAX_S, MAX_BYTES = 10, 2 << 30
BYTES_PER_S = 1 << 20  # of a file with many small datasets, a tenth of what was measured: so much longer it may take
NAMES = (  # of attributes, asked for although the list of them may be damaged
    *("uid", "spec", "provenance", "success", "digest", "num_samples", "model_file", "total", "env_args"),
    *("id", "total_steps"),
)
PROGRAM = f"""
import os, resource, sys
limit = {MAX_S} + os.path.getsize(sys.argv[1]) // {BYTES_PER_S}
resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
resource.setrlimit(resource.RLIMIT_AS, ({MAX_BYTES}, {MAX_BYTES}))
import h5py
def tried(read):
    try:
        return read()
    except Exception:
        return ()
def visit(item):
    named = NAMES if isinstance(item, h5py.Group) else ()
    for key in {{*named, *tried(lambda: list(item.attrs))}}:
        tried(lambda: item.attrs.get(key))
    if isinstance(item, h5py.Dataset) and tried(lambda: item.shape and not (item.external or item.is_virtual)):
        tried(lambda: item[:1])
        tried(lambda: item[-1:])
def inside(group):
    for name in tried(lambda: list(group)):
        if isinstance(tried(lambda: group.get(name, getlink=True)), h5py.HardLink):
            yield tried(lambda: group[name])
NAMES = {NAMES}
try:
    with h5py.File(sys.argv[1], "r") as file:
        found, seen = [file], set()
        while found:
            item = found.pop()
            place = tried(lambda: h5py.h5o.get_info(item.id).addr)
            if place not in seen:
                seen.add(place)
                visit(item)
                found += inside(item) if isinstance(item, h5py.Group) else ()
except Exception:
    pass
"""


def require_readable(path: Path) -> None:
    """Refuse a file in which the library stays, or dies; whatever else is wrong with it, its reader says.

    Raises:
        DemoError: it would not have come back, or is a pipe or a device.
    """
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise DemoError(path, "is not a regular file.")
    if not comes_back(str(path), found.st_mtime_ns, found.st_size):
        raise DemoError(path, "is damaged: the HDF5 library does not come back from it.")


@lru_cache(maxsize=4096)  # a dataset may be as many files, each looked at more than once
def comes_back(path: str, changed_ns: int, size: int) -> bool:
    words = [sys.executable, "-I", "-c", PROGRAM, os.path.abspath(path)]
    ended = subprocess.run(words, capture_output=True, check=False).returncode
    if ended == -signal.SIGKILL:
        raise DemoError(path, "could not be looked at: the process that did so was killed.", hint="Is memory short?")
    return ended >= 0
