"""A probe of whether the HDF5 library returns from a file at all: in some damaged ones it loops for ever.

So a process of its own, with little memory and processor time, opens all objects and reads their attributes and the
ends of their data first; each by itself, as one that raises says nothing of the next. Time on the clock decides
nothing: on a busy computer a sound file may take long.
"""

import os
import signal
import stat
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from aerial_il.core.errors import DemoError

MAX_S, MAX_BYTES = 10, 2 << 30
BYTES_PER_S = 1 << 20  # of a file with many small datasets, a tenth of what was measured: so much longer it may take
NAMES = (  # of attributes, asked for although the list of them may be damaged
    *("uid", "spec", "provenance", "success", "digest", "num_samples", "model_file", "total", "env_args"),
    *("id", "total_steps"),
)
PROBE = f"""
import os, resource, sys
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
def probe(path):
    limit = {MAX_S} + os.path.getsize(path) // {BYTES_PER_S}
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_AS, ({MAX_BYTES}, {MAX_BYTES}))
    with h5py.File(path, "r") as file:
        found, seen = [file], set()
        while found:
            item = found.pop()
            place = tried(lambda: h5py.h5o.get_info(item.id).addr)
            if place not in seen:
                seen.add(place)
                visit(item)
                found += inside(item) if isinstance(item, h5py.Group) else ()
"""
PROGRAM = f"""{PROBE}
for path in sys.stdin.buffer.read().split(bytes(1)):
    child = os.fork()
    if not child:
        tried(lambda: probe(path))
        os._exit(0)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


ended: dict[tuple[str, int, int], int] = {}  # how the process ended that looked at a file, by what changes with it


def require_readable(path: Path) -> None:
    """Refuse a file in which the library stays, or dies; whatever else is wrong with it, its reader says.

    Raises:
        DemoError: it would not have come back, or is a pipe or a device.
    """
    look_at([path])
    how = ended.get(known_by(path), -signal.SIGKILL)
    if how == -signal.SIGKILL:
        raise DemoError(path, "could not be looked at: the process that did so was killed.", hint="Is memory short?")
    if how < 0:
        raise DemoError(path, "is damaged: the HDF5 library does not come back from it.")


def look_at(paths: Iterable[Path]) -> None:
    """Look at several files at once, each in a process of its own, which one that has the library loaded forks.

    Raises:
        DemoError: one is a pipe or a device.
    """
    unknown = {os.path.abspath(path): key for path in paths if (key := known_by(path)) not in ended}
    if unknown:
        given = b"\0".join(map(os.fsencode, unknown))
        probe = subprocess.run([sys.executable, "-I", "-c", PROGRAM], input=given, capture_output=True, check=False)
        found = map(int, probe.stdout.split())
        ended.update((key, how) for key, how in zip(unknown.values(), found, strict=False) if how != -signal.SIGKILL)


def known_by(path: Path) -> tuple[str, int, int]:
    """Return what changes with a regular file."""
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise DemoError(path, "is not a regular file.")
    return str(path), found.st_mtime_ns, found.st_size
