"""The flight laws that a vehicle can be flown by: one vocabulary for environments, configurations and studies.

A law brings the base to its reference: its wrench is what differs. Everything around it is shared, so that a comparison
is one of laws: the reference that the whole-body planner makes, the arm's servos with their feed-forward torque, the
allocation with its priorities, the rotors. At the levels ``ctbr`` and ``rotor`` the action takes the law's place.
``docs/controllers.md`` derives each of them.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from aerial_il.control.hover import hover_body
from aerial_il.control.lqr import feedback_matrix
from aerial_il.control.vehicle import Gains, Vehicle
from aerial_il.core.errors import UnknownNameError


class Law(IntEnum):
    """Flight laws, by which the base is flown to its reference."""

    GEOMETRIC_OBSERVER = 0
    GEOMETRIC = 1
    PID = 2
    LQR = 3

    @property
    def label(self) -> str:
        """Name used in configurations, e.g. ``geometric_observer``."""
        return self.name.lower()

    @property
    def summary(self) -> str:
        """The law in a few words."""
        return _SUMMARIES[self]

    @property
    def gains(self) -> Gains:
        """Its tuning; the observer belongs to the first law alone."""
        if self == Law.GEOMETRIC_OBSERVER:
            return Gains()
        return Gains(law=int(self), observer=0.0, observer_loaded=0.0)

    def record(self, vehicle: Vehicle) -> np.record:
        """The vehicle's record with what this law must know of it."""
        record = vehicle.record
        if self >= Law.PID:
            body = hover_body(vehicle)
            record["hover_com"], record["hover_inertia"] = body.com, np.diag(body.inertia)
        if self == Law.LQR:
            record["feedback"] = feedback_matrix(vehicle)
        return record

    @staticmethod
    def parse(name: str) -> Law:
        """Return the law called ``name``.

        Raises:
            UnknownNameError: no law has that name.
        """
        for law in Law:
            if law.label == name:
                return law
        raise UnknownNameError("controller", name, names())


_SUMMARIES = {
    Law.GEOMETRIC_OBSERVER: "geometric tracking on SE(3), arm fed forward, disturbance observer",
    Law.GEOMETRIC: "the same without the observer",
    Law.PID: "textbook cascade: PID for position and attitude, hover thrust fed forward",
    Law.LQR: "textbook state feedback about hover, trimmed for the arm at rest",
}


def names() -> tuple[str, ...]:
    """Names of all laws, the default first."""
    return tuple(law.label for law in Law)
