"""A loader that gathers the next minibatches in a thread while the trainer works on the present one."""

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Any, Self

Minibatch = tuple[Any, ...]
AHEAD = 2  # minibatches of images; those of states alone are gathered faster than a thread is woken


class Loader:
    """Hands out the minibatch of one step after the other; use it in a ``with`` block.

    What it hands out is a function of the step alone, so that a resumed run sees what an uninterrupted one would.

    Args:
        gather: returns the minibatch of a step; it must not draw random numbers.
        first: the first step that will be asked for.
        last: gather none from this step on.
        ahead: how many to have ready; 0 gathers each when it is asked for.
    """

    def __init__(self, gather: Callable[[int], Minibatch], *, first: int, last: int, ahead: int) -> None:
        self._gather, self._next, self._last, self._ahead = gather, first, last, ahead
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="loader") if ahead else None
        self._coming: dict[int, Future[Minibatch]] = {}
        self._waited_s = 0.0
        self._since_s = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        if self._thread:
            self._thread.shutdown(wait=True, cancel_futures=True)

    def take(self, step: int) -> Minibatch:
        """Return the minibatch of ``step``, and set about those that follow."""
        started = time.perf_counter()
        if self._thread:
            for coming in range(max(step, self._next), min(step + self._ahead + 1, self._last)):
                self._coming[coming] = self._thread.submit(self._gather, coming)
                self._next = coming + 1
        ready = self._coming.pop(step, None)
        batch = ready.result() if ready else self._gather(step)
        self._waited_s += time.perf_counter() - started
        return batch

    def wait_share(self, elapsed_s: float) -> float:
        """Return which share of the step time was spent waiting for minibatches since the last call.

        Args:
            elapsed_s: total time of all steps so far.
        """
        share = self._waited_s / max(elapsed_s - self._since_s, 1e-9)
        self._waited_s, self._since_s = 0.0, elapsed_s
        return share
