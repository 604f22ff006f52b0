"""Run a compiled, GIL-free function over slices of the worlds on several threads."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

FEWEST_WORLDS = 32  # below this, handing work to a thread costs more than it saves


def available_cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


class Crew:
    """Threads that share the worlds of one simulation evenly, the caller's own among them.

    Args:
        n: worlds. num_threads: 0 for all cores.
    """

    def __init__(self, n: int, num_threads: int = 0) -> None:
        hands = 1 if n < FEWEST_WORLDS else min(num_threads or available_cores(), n)
        edges = [round(n * k / hands) for k in range(hands + 1)]
        self._slices = [slice(a, b) for a, b in itertools.pairwise(edges)]
        self._pool = ThreadPoolExecutor(hands - 1, "aerial_il-crew") if hands > 1 else None

    def run(self, work: Callable[[slice], None]) -> None:
        """Call ``work`` once per slice of the worlds and wait for all of them."""
        if self._pool is None:
            work(self._slices[0])
            return
        pending = [self._pool.submit(work, part) for part in self._slices[1:]]
        work(self._slices[0])
        for task in pending:
            task.result()

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
