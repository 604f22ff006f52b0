"""What is said of work that takes long, in the words that a log gets."""

import io

import pytest

from aerial_il.core import progress
from aerial_il.core.progress import Progress


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time that a bar sees, in its only element."""
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def shown(clock: list[float], seconds: list[float], **settings: float) -> str:
    """Return what a bar over 1,000 steps writes, whose steps take these seconds."""
    log = io.StringIO()
    with Progress(total=1000, desc="train act", unit="step", file=log, **settings) as bar:
        for each in seconds:
            clock[0] += each
            bar.update()
    return log.getvalue()


def test_long_work_says_so_once_and_early(clock: list[float]) -> None:
    said = shown(clock, [20.0, 2.0, 2.0, 2.0, 2.0])
    assert said.count("train act: about 33 min to go, at 0.5 steps a second on this machine") == 1
    assert said.count("to go") == 1, "the first step, which starts everything, is not measured"


def test_short_or_limited_work_says_nothing(clock: list[float]) -> None:
    assert "to go" not in shown(clock, [0.5] * 20)
    assert "to go" not in shown(clock, [2.0] * 5, limit_s=300.0)
    assert "about 15 min to go" in shown(clock, [2.0] * 5, limit_s=900.0)
    assert shown(clock, [2.0] * 5, disable=True) == ""
