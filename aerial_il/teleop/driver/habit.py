"""How one person flies one flight: which way round, how high, how fast, how carefully. Others, and tomorrow, differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Habit:
    """The manner of one flight.

    Attributes:
        side: m, by which the way there bends to the left. height: m, above a thing before going down to it.
        speed: m/s at most. gain: 1/s, speed for each metre that is left. turns_first: whether it turns before it goes.
        pause_ticks: mean of the stops between two parts of the task. stops: chance of one more at any tick.
        tremor: standard deviation of the hand, as a share of the stick's way.
    """

    side: float
    height: float
    speed: float
    gain: float
    turns_first: bool
    pause_ticks: float
    stops: float = 0.002
    tremor: float = 0.04

    @staticmethod
    def draw(rng: np.random.Generator) -> Habit:
        """Return one of the habits that there are: left or right, high or low, fast or slow, turning first or last."""
        fast = rng.random() < 0.5
        return Habit(
            side=float(rng.choice((-1.0, 1.0)) * rng.uniform(0.06, 0.14)),
            height=float(rng.choice((0.10, 0.20)) + rng.uniform(-0.015, 0.015)),
            speed=float(rng.uniform(0.30, 0.40) if fast else rng.uniform(0.16, 0.22)),
            gain=1.6 if fast else 1.2,
            turns_first=bool(rng.random() < 0.5),
            pause_ticks=8.0 if fast else 20.0,
        )
