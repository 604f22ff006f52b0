"""Signals that end a process by an exception: none is lost, and none leaves a lock held."""

import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager

import pytest

from aerial_il.core.interruption import answering, end, heard
from tests.patience import HANG_S

ROUNDS = 100


@contextmanager
def handled(by: object) -> Iterator[None]:
    before = signal.signal(signal.SIGTERM, by)  # pyright: ignore[reportArgumentType]
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def locks_left() -> int:
    """Return how many of ``ROUNDS`` signals left the lock of a future held, sent while its state was asked for."""
    waits, left = random.Random(0), 0

    def ask() -> None:
        time.sleep(waits.uniform(0.0, 0.002))
        os.kill(os.getpid(), signal.SIGTERM)

    def look_until_it_is_heard(asking: threading.Thread) -> None:
        asking.start()
        while True:
            future.done()

    for _ in range(ROUNDS):
        future: Future[None] = Future()
        asking = threading.Thread(target=ask)
        with pytest.raises(SystemExit):
            look_until_it_is_heard(asking)
        asking.join()
        left += future._condition._is_owned()  # pyright: ignore[reportAttributeAccessIssue]
    return left


def test_no_lock_is_left_held() -> None:
    with handled(answering(end)):
        assert locks_left() == 0


def test_a_handler_that_raises_at_once_leaves_locks_held() -> None:
    with handled(lambda number, frame: end(number)):
        assert locks_left() > 0


FINALISER = """
import os, signal, time
from aerial_il.core.interruption import heard

class Closing:
    def __del__(self):
        os.kill(os.getpid(), signal.{name})

signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell that runs it in the background lets it ignore this
with heard():
    closing = Closing()
    del closing
    time.sleep(60)
"""


@pytest.mark.parametrize(("name", "status"), [("SIGTERM", 143), ("SIGINT", -signal.SIGINT)])
def test_what_a_finaliser_ignores_is_said_again(name: str, status: int) -> None:
    code = FINALISER.format(name=name)
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=HANG_S, check=False)
    assert ended.returncode == status, ended.stderr
    assert "ignored" not in ended.stderr


def test_other_exceptions_of_finalisers_are_shown_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    class Wrong:
        def __del__(self) -> None:
            raise ValueError("wrong")

    shown = []
    monkeypatch.setattr(sys, "unraisablehook", lambda lost: shown.append(str(lost.exc_value)))
    hook, before = sys.unraisablehook, signal.getsignal(signal.SIGTERM)
    with heard():
        wrong = Wrong()
        del wrong
    signal.signal(signal.SIGTERM, before)
    assert shown == ["wrong"]
    assert sys.unraisablehook is hook
