"""Where a program's time goes, from samples of what its main thread is busy with."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Mapping, Sequence
from types import FrameType, TracebackType
from typing import NamedTuple, Self

INTERVAL_S = 0.002


class Place(NamedTuple):
    """Some of the code.

    Attributes:
        module: of it, or a package that it lies in. function: its name there; empty for all.
    """

    module: str
    function: str = ""

    def holds(self, frame: FrameType) -> bool:
        """Whether a frame executes it."""
        module = frame.f_globals.get("__name__", "")
        inside = module == self.module or module.startswith(f"{self.module}.")
        return inside and self.function in ("", frame.f_code.co_name)


class Sampler:
    """Time by section of the code, sampled while the ``with`` block runs, in the main thread.

    A sample belongs to the section of the innermost frame that any section holds, and counts for the time since the
    one before. Compiled code is not interrupted: once it returns, its time counts for who called it. The clock to the
    next sample starts when one has been taken, so that on a machine too busy to take one in time they do not pile up.

    Args:
        sections: name -> places. rest: name of what none of them holds. clock: of wall time, or another, s.

    Attributes:
        seconds: section -> total.
    """

    def __init__(
        self, sections: Mapping[str, Sequence[Place]], *, rest: str, clock: Callable[[], float] = time.perf_counter
    ) -> None:
        self._sections, self._rest, self._clock, self._runs = sections, rest, clock, False
        self.clear()

    def clear(self) -> None:
        """Begin anew."""
        self.seconds = dict.fromkeys([*self._sections, self._rest], 0.0)
        self._last = self._clock()

    def __enter__(self) -> Self:
        self._before = signal.signal(signal.SIGALRM, self._sample)
        signal.siginterrupt(signal.SIGALRM, False)
        self.clear()
        self._runs = True
        signal.setitimer(signal.ITIMER_REAL, INTERVAL_S)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._runs = False
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, self._before)

    def _sample(self, number: int, frame: FrameType | None) -> None:
        now = self._clock()
        self.seconds[self._section(frame)] += now - self._last
        self._last = now
        if self._runs:
            signal.setitimer(signal.ITIMER_REAL, INTERVAL_S)

    def _section(self, frame: FrameType | None) -> str:
        while frame:
            for name, places in self._sections.items():
                if any(place.holds(frame) for place in places):
                    return name
            frame = frame.f_back
        return self._rest
