"""Progress on stderr: a bar on a terminal, a line every few seconds in a log; what takes long says so early."""

import math
import sys
import time
from collections.abc import Callable
from typing import Any

from tqdm import tqdm

LINE_EVERY_S = 5.0
MEASURED_S = 3.0  # before it is said how long something takes
LONG_S = 600.0  # of what it is said


class Progress(tqdm):  # pyright: ignore[reportMissingTypeArgument]
    """tqdm, whose carriage returns would fill a log where there is no terminal.

    Args:
        limit_s: seconds after which it ends anyhow. The rest: tqdm's own.
    """

    def __init__(self, *args: Any, limit_s: float | None = None, **kwargs: Any) -> None:
        if not is_terminal(kwargs.get("file") or sys.stderr):
            kwargs |= {"mininterval": LINE_EVERY_S, "miniters": 1, "ncols": 80, "dynamic_ncols": False}
        self._limit_s = limit_s
        self._first: tuple[float, float] | None = 0.0, 0.0  # time and count after the first update, which is slow
        super().__init__(*args, **kwargs)

    def update(self, n: float | None = 1) -> bool | None:
        """Advance, as tqdm does; some seconds after the first step say, once, how long the rest takes."""
        shown = super().update(n)
        if self.disable or not self.total or self._first is None:
            return shown
        now, (start, before) = time.monotonic(), self._first
        if not start:
            self._first = now, self.n
        elif now - start > MEASURED_S and self.n > before:
            self._first = None
            self._say_how_long((self.n - before) / (now - start))
        return shown

    def _say_how_long(self, rate: float) -> None:
        left_s = min((self.total - self.n) / rate, self._limit_s or math.inf)
        if left_s < LONG_S:
            return
        said = f"{self.desc}: about {left_s / 60:.0f} min to go, at {rate:.2g} {self.unit}s a second on this machine"
        if is_terminal(self.fp):
            self.write(said, file=self.fp)
        else:
            self.fp.write(f"\n{said}")

    @staticmethod
    def status_printer(file: Any) -> Callable[[str], None]:
        """Return what writes a state of the bar: over the last one, or in a log below it; tqdm ends the last line."""
        if is_terminal(file):
            return tqdm.status_printer(file)
        started = False

        def write_line(state: str) -> None:
            nonlocal started
            if state:
                file.write("\n" * started + state.rstrip())
                file.flush()
                started = True

        return write_line


def is_terminal(file: Any) -> bool:
    """Whether ``file`` is a terminal, on which lines can be written over."""
    return hasattr(file, "isatty") and file.isatty()
