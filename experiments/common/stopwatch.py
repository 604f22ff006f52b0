"""Time, taken so that arms can be compared on a machine that is doing other things too."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import numpy as np


class Stopwatch:
    """Sums of wall time by section.

    Attributes:
        seconds: section -> total.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)

    @contextmanager
    def section(self, name: str) -> Iterator[None]:
        """Add the time spent inside to ``name``."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] += time.perf_counter() - started


class Arm:
    """Something to be timed.

    Args:
        run: the timed part. prepare: what comes before each run, untimed. units: how much work one run does.
        clock: seconds; of the wall, or of the processor.
    """

    def __init__(
        self, run: Callable[[], None], *, units: int, prepare: Callable[[], object] = lambda: None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:  # fmt: skip
        self.run, self.prepare, self.units, self.clock = run, prepare, units, clock

    def rate(self) -> float:
        """Run once; return units per second."""
        self.prepare()
        started = self.clock()
        self.run()
        return self.units / (self.clock() - started)


def interleave(arms: Mapping[str, Arm], repetitions: int) -> dict[str, np.ndarray]:
    """Time every arm once per repetition, one right after the other, so that a slow moment slows them all.

    Returns:
        arm -> (repetitions,) units per second; a first round, which warms caches up, is left out.
    """
    rounds = [{name: arm.rate() for name, arm in arms.items()} for _ in range(repetitions + 1)]
    return {name: np.array([one[name] for one in rounds[1:]]) for name in arms}
