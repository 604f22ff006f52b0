"""Signals that end what runs by an exception, which Python raises between any two instructions of the main thread.

Two of these places lose it. Where a ``threading.Condition`` is entered or left, which is Python code, the lock stays
held: threads that want it wait forever, and the process with them as it ends. In a finaliser or a callback from C the
exception is ignored. In both the signal is sent again a moment later.

Source: the documentation of ``signal``, "Note on Signal Handlers and Exceptions", and of ``sys.unraisablehook``.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import _base as futures
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn

type Handler = Callable[[int, FrameType | None], None]

AGAIN_S = 0.002
_RAISED = {SystemExit: signal.SIGTERM, KeyboardInterrupt: signal.SIGINT}
_PAIRS = (threading.Condition, getattr(futures, "_AcquireFutures", threading.Condition))
_LOCKING = {getattr(pair, name).__code__ for pair in _PAIRS for name in ("__enter__", "__exit__")}


def answering(answer: Callable[[int], None]) -> Handler:
    """Return a handler of signals that calls ``answer(number)`` only where its exception leaves no lock held."""

    def handle(number: int, frame: FrameType | None) -> None:
        if frame is not None and frame.f_code in _LOCKING:
            _send_again(number)
        else:
            answer(number)

    return handle


def end(number: int) -> NoReturn:
    """Leave with the status that shells give a signal.

    Raises:
        SystemExit: always.
    """
    raise SystemExit(128 + number)


@contextmanager
def heard() -> Iterator[None]:
    """End what runs inside on SIGTERM, whatever ignores an exception; only in the main thread.

    SIGINT keeps its handler: ``asyncio`` takes over no other than Python's own, and people press Ctrl-C twice.
    """
    signal.signal(signal.SIGTERM, answering(end))
    before = sys.unraisablehook

    def notice(lost: Any) -> None:
        if number := _RAISED.get(lost.exc_type):
            _send_again(number)
        else:
            before(lost)

    sys.unraisablehook = notice
    try:
        yield
    finally:
        sys.unraisablehook = before


def _send_again(number: int) -> None:
    """Send a signal to this process soon, from a thread started without any lock of ``threading``."""

    def send() -> None:
        time.sleep(AGAIN_S)
        os.kill(os.getpid(), number)

    threading._start_new_thread(send, ())  # pyright: ignore[reportAttributeAccessIssue]
