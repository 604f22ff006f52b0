"""Progress is a line now and then in a log, and one that is written over on a terminal."""

from __future__ import annotations

import contextlib
import io
import os
import pty
import re

import pytest

from aerial_il.core import progress
from aerial_il.core.progress import Progress


@pytest.fixture(autouse=True)
def _time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each look at the clock is 10 ms later."""
    ticks = iter(range(10**9))
    monkeypatch.setattr("tqdm.std.time", lambda: next(ticks) / 100)


def test_a_log_gets_a_line_every_few_seconds() -> None:
    log = io.StringIO()
    for _ in Progress(range(3000), desc="convert", unit="ep", file=log):
        pass
    lines = log.getvalue().splitlines()
    assert "\r" not in log.getvalue()
    assert 3 <= len(lines) <= 30.0 / progress.LINE_EVERY_S + 3
    assert all(re.match(r"convert: +\d+%\|.*\| \d+/3000 ", line) for line in lines)
    assert "3000/3000" in lines[-1]
    assert log.getvalue().endswith("\n")


def test_who_wants_none_gets_none() -> None:
    log = io.StringIO()
    assert len(list(Progress(range(3), file=log, disable=True))) == 3
    assert log.getvalue() == ""


def test_a_terminal_gets_one_line_that_moves() -> None:
    reader, writer = pty.openpty()
    with os.fdopen(writer, "w") as terminal:
        for _ in Progress(range(3000), file=terminal, ncols=60):
            pass
    shown = _all_of(reader)
    os.close(reader)
    assert shown.count("\r") > 30


def _all_of(reader: int) -> str:
    """Return all that a terminal was sent, in one part or several; its end, once the writer is closed, is an error."""
    shown = b""
    with contextlib.suppress(OSError):
        while part := os.read(reader, 1 << 16):
            shown += part
    return shown.decode()
