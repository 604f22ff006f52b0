"""Run a compiled, GIL-free function over ranges of the worlds on several threads."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

FEWEST_WORLDS = 4  # below this, handing work to a thread costs more than it saves
SHARES_PER_THREAD = 4  # so that a thread that was held up does not hold up the others


def available_cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


class Crew:
    """Threads that share the worlds of one simulation, the caller's own among them.

    Args:
        n: worlds. num_threads: 0 for all cores.
    """

    def __init__(self, n: int, num_threads: int = 0) -> None:
        self._hands = 1 if n < FEWEST_WORLDS else min(num_threads or available_cores(), n)
        shares = 1 if self._hands == 1 else min(n, SHARES_PER_THREAD * self._hands)
        edges = [round(n * k / shares) for k in range(shares + 1)]
        self._ranges = list(itertools.pairwise(edges))
        self._pool = ThreadPoolExecutor(self._hands - 1, "aerial_il-crew") if self._hands > 1 else None

    def run(self, work: Callable[[int, int], None]) -> None:
        """Call ``work(first, stop)`` for every range of the worlds, each thread taking the next that is left."""
        remaining = iter(self._ranges)  # next() of a list's iterator is atomic

        def take() -> None:
            for first, stop in remaining:
                work(first, stop)

        if self._pool is None:
            take()
            return
        pending = [self._pool.submit(take) for _ in range(self._hands - 1)]
        take()
        for task in pending:
            task.result()

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
