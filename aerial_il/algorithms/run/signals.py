"""A watch for SIGINT and SIGTERM that lets the training step end and its checkpoint be written first."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Self

from aerial_il.core.interruption import answering, end

WATCHED = (signal.SIGINT, signal.SIGTERM)


class SignalWatch:
    """Within the ``with`` block a first signal only sets :attr:`pending`; a second one stops at once.

    Off the main thread, where Python delivers no signals, it does nothing.
    """

    def __init__(self) -> None:
        self.pending: int | None = None
        self._at_once = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, answering(self._receive)) for number in WATCHED}
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def stop(self) -> None:
        """Leave because of the pending signal.

        Raises:
            KeyboardInterrupt: on SIGINT (exit status 130).
            SystemExit: on SIGTERM, with status 143.
        """
        if self.pending == signal.SIGTERM:
            end(signal.SIGTERM)
        raise KeyboardInterrupt

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Let the first signal stop what runs inside; for long work that has nothing to save."""
        if self.pending is not None:
            self.stop()
        self._at_once = True
        try:
            yield
        finally:
            self._at_once = False

    def _receive(self, number: int) -> None:
        second, self.pending = self.pending is not None, number
        if second or self._at_once:
            self.stop()
