"""What a flight law is: tuning, numbers that it knows of a vehicle, and a kernel that brings the base to its reference.

Its wrench is what differs. Everything around it is shared, so that a comparison is one of laws: the reference that the
whole-body planner makes, the arm's servos with their feed-forward torque, the allocation with its priorities, the
rotors. At the levels ``ctbr`` and ``rotor`` the action takes the law's place.

A file in this folder defines a frozen dataclass that is called as the file, and a compiled function

    steer(own, vehicle, gains, scratch, state)   at 250 Hz

``own`` is a record of what :meth:`Law.numbers` returns. The motion of the base stands in ``scratch``, see
:data:`aerial_il.control.scratch.SCRATCH`: the law writes ``scratch.force`` (N) and ``scratch.torque`` (N m, about the
base origin), both in the base frame, and calls :func:`feed_arm_forward` with the acceleration that it commands. From
``state[LAW]`` on it may remember ``LAW_SIZE`` numbers; the base's reference is there, too, see ``controller_state``.
"""

from typing import Any, ClassVar

import numpy as np

from aerial_il.control.vehicle import Gains, Vehicle
from aerial_il.core.addresses import record_of_numbers


class Law:
    """A flight law; frozen dataclasses inherit from it.

    Attributes:
        summary: the law in a few words.
    """

    summary: ClassVar[str]

    @property
    def gains(self) -> Gains:
        """Its tuning: without a disturbance observer, unless it says otherwise."""
        return Gains(observer=0.0, observer_loaded=0.0)

    def numbers(self, vehicle: Vehicle) -> dict[str, Any]:
        """Return what the kernel must know of a vehicle beyond its record: numbers and arrays by name."""
        return {}

    def record(self, vehicle: Vehicle) -> np.ndarray:
        """Return ``own`` (1,) of its kernel."""
        return record_of_numbers(self.numbers(vehicle))
