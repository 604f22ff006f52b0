"""Run a compiled, GIL-free function over the worlds on several threads."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait

import numpy as np

FEWEST_WORLDS = 4  # below this, waking a thread costs more than it saves
CORES = "AERIAL_IL_CORES"  # environment: how many cores a process may use, where several share a machine


def available_cores() -> int:
    """Cores this process may use."""
    if (given := os.environ.get(CORES, "")).isdecimal():
        return max(1, int(given))
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


class ThreadPool:
    """Threads that share the worlds of one simulation, the caller's own among them.

    Args:
        n: worlds. num_threads: 0 for all cores.

    Attributes:
        hands: threads, the caller's own among them.
    """

    def __init__(self, n: int, num_threads: int = 0) -> None:
        self.hands = 1 if n < FEWEST_WORLDS else min(num_threads or available_cores(), n)
        self._drawn = np.zeros(1, np.int64)
        self._counter = self._drawn.ctypes.data
        self._helpers = self.hands - 1
        self._pool = ThreadPoolExecutor(self._helpers, "aerial_il-worlds") if self._helpers else None

    def run(self, work: Callable[[int], None]) -> None:
        """Call ``work(counter)`` on every thread; each world it takes is the next number drawn from ``counter``.

        Drawing one world at a time keeps all threads busy to the end, however unequal worlds and cores are. ``counter``
        is the address of an ``int64``, see :func:`aerial_il.suite.physics.native.draw`.
        """
        self._drawn[0] = 0
        counter = self._counter
        if self._pool is None:
            work(counter)
            return
        pending = [self._pool.submit(work, counter) for _ in range(self._helpers)]
        try:
            work(counter)
        finally:
            wait(pending)  # an interrupt must not free worlds that others still fly
        for task in pending:
            task.result()

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
