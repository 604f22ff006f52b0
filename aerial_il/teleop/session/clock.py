"""Ticks on absolute deadlines: late ones are counted, and made up for; none is left out."""

import time
from collections import deque
from dataclasses import dataclass

LATE_S = 0.005  # a tick that begins later than this after its deadline counts as late
HOPELESS_S = 0.25  # further behind than this, deadlines start anew: a machine that slept must not fly in fast motion
WINDOW = 250  # ticks that the shown figures are of


@dataclass(frozen=True)
class Pace:
    """How well a loop keeps time.

    Attributes:
        rate: ticks per second of the last 5 s. on_time: share of all ticks. late: number of late ones.
        ticks: number of all.
    """

    rate: float
    on_time: float
    late: int
    ticks: int


class Metronome:
    """Waits for the next deadline.

    Args:
        period: s between ticks.
    """

    def __init__(self, period: float) -> None:
        self._period, self._due = period, time.perf_counter() + period
        self._starts: deque[float] = deque(maxlen=WINDOW)
        self._ticks = self._late = 0

    def wait(self) -> float:
        """Return at the next deadline, at once if it is over; say how late that was, s."""
        if (left := self._due - time.perf_counter()) > 0.0:
            time.sleep(left)
        started = time.perf_counter()
        behind = started - self._due
        self._ticks += 1
        self._late += behind > LATE_S
        self._starts.append(started)
        self._due = started + self._period if behind > HOPELESS_S else self._due + self._period
        return max(0.0, behind)

    @property
    def pace(self) -> Pace:
        """How well time was kept."""
        span = self._starts[-1] - self._starts[0] if len(self._starts) > 1 else 0.0
        rate = (len(self._starts) - 1) / span if span else 0.0
        on_time = 1.0 - self._late / self._ticks if self._ticks else 1.0
        return Pace(round(rate, 2), round(on_time, 4), self._late, self._ticks)
