"""Geometric tracking with a disturbance observer: the law of every flight that names none."""

from dataclasses import dataclass
from typing import ClassVar

from aerial_il.control.controllers.geometric import steer
from aerial_il.control.controllers.law import Law
from aerial_il.control.vehicle import Gains

__all__ = ["GeometricObserver", "steer"]


@dataclass(frozen=True)
class GeometricObserver(Law):
    """The geometric law, whose momentum-based observer (De Luca & Mattone 2003) is at work."""

    summary: ClassVar[str] = "geometric tracking on SE(3), arm fed forward, disturbance observer"

    @property
    def gains(self) -> Gains:
        return Gains()
