"""What a person makes of the page: its numbers, a reaction time late, and not quite right."""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from aerial_il.teleop.session.readings import SHOWN, Reading
from aerial_il.teleop.session.status import Status

DRIFT_TICKS = 20.0  # for how long an error of the eye stays about the same
ERROR_M, ERROR_SHARE, ERROR_RAD = 0.003, 0.04, 0.03  # standard deviations: of lengths, as a share of them, of angles
SI = {unit: factor for factor, unit in SHOWN.values()} | {"%": 100.0}


@dataclass(frozen=True)
class Sight:
    """What is seen at one moment.

    Attributes:
        status: of the page. numbers: its readings by title, in SI units, gripper from 0 to 1.
    """

    status: Status
    numbers: Mapping[str, tuple[float, ...]]


class Eyes:
    """Looks at the page.

    Args:
        readings: the rows of numbers that the page shows. reaction_ticks: between what is shown and what is done.
        rng: of the errors.
    """

    def __init__(self, readings: Sequence[Reading], *, reaction_ticks: int, rng: np.random.Generator) -> None:
        self._readings, self._rng = tuple(readings), rng
        self._shown: deque[Status] = deque(maxlen=reaction_ticks + 1)
        self._error = np.zeros((2, sum(len(reading.poles) for reading in readings)))

    def look(self, status: Status) -> Sight:
        """Take in what is shown now; return what was shown a reaction time ago, as it seemed."""
        self._shown.append(status)
        keep = 1.0 - 1.0 / DRIFT_TICKS
        fresh = self._rng.normal(size=self._error.shape)
        self._error = keep * self._error + math.sqrt(1.0 - keep * keep) * fresh
        return Sight(self._shown[0], self._numbers(self._shown[0].numbers))

    def _numbers(self, shown: Sequence[float]) -> dict[str, tuple[float, ...]]:
        numbers, at = {}, 0
        for reading in self._readings:
            unit = SHOWN.get(reading.unit, (1.0, reading.unit))[1]
            places = range(at, at + len(reading.poles))
            numbers[reading.title] = tuple(self._seen(shown[i] / SI.get(unit, 1.0), unit, i) for i in places)
            at += len(reading.poles)
        return numbers

    def _seen(self, value: float, unit: str, place: int) -> float:
        steady, growing = self._error[:, place]
        if unit == "cm":
            return float(value + ERROR_M * steady + ERROR_SHARE * abs(value) * growing)
        return float(value + ERROR_RAD * steady) if unit == "°" else value
