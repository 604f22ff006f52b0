"""Memory that this computer has left, and how much of it one episode may take."""

import os
from pathlib import Path

MEMINFO, CGROUP = Path("/proc/meminfo"), Path("/sys/fs/cgroup")
MEMORY_MB = 2000  # of one episode, unless more is asked for
HELD_MB = 500  # of all that is trained on, likewise


def free_memory_bytes() -> int:
    """Return how much memory can still be taken without swapping, a container's limit respected."""
    return min(_free_of_machine(), _free_of_container())


def _free_of_machine() -> int:
    try:
        line = next(line for line in MEMINFO.read_text().splitlines() if line.startswith("MemAvailable:"))
        return 1024 * int(line.split()[1])
    except (OSError, StopIteration, ValueError):
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")  # no Linux: what there is in all


def _free_of_container() -> int:
    """Return the control group's limit less what is used, file caches, which give way, not counted."""
    try:
        limit, used = (int((CGROUP / name).read_text()) for name in ("memory.max", "memory.current"))
        cached = dict(line.split() for line in (CGROUP / "memory.stat").read_text().splitlines())
        return limit - used + int(cached["file"])
    except (OSError, KeyError, ValueError):  # no control group, or one without a limit ("max")
        return 2**63
