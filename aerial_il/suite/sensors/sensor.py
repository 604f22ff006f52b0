"""What a sensor is: settings, the fields that it adds to a robot's observation, and a kernel that reads them.

A file in this folder defines a frozen dataclass that is called as the file, and a compiled function

    read(own, world, seen, found)   after every control step: writes ``found``, the numbers of the fields in a row

``own`` is a record of what :meth:`Sensor.numbers` returns, with ``stream``, the first channel of its random numbers.
``world`` is the truth, and ``seen`` the same as the robot estimates it: both are read by the functions of
:mod:`aerial_il.suite.physics.world`, of which ``seed`` and ``tick`` make a random number one of this moment.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import ClassVar
from zlib import crc32

import numpy as np

from aerial_il.core.addresses import record_of_numbers
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot

XYZ = ("x", "y", "z")
ROT6D = ("xx", "xy", "xz", "yx", "yy", "yz")
ESTIMATED = "that of the flight controller's estimate under `estimation`, else exact"
ENCODED = "none: encoders count as exact"


class Sensor:
    """Settings of one sensor: frozen dataclasses inherit from it.

    Attributes:
        stream: first channel of its random numbers; None for one by its name.
    """

    stream: ClassVar[int | None] = None

    def fields(self, robot: Robot) -> tuple[Field, ...]:
        """Return the fields on a robot, each one-dimensional; none where it does not fit the robot."""
        raise NotImplementedError

    def numbers(self, robot: Robot) -> dict[str, float]:
        """Return what the kernel reads, by name."""
        return asdict(self)  # type: ignore[call-overload]

    def record(self, name: str, robot: Robot) -> np.ndarray:
        """Return ``own`` (1,) of the kernel of the sensor that is registered as ``name``."""
        stream = crc32(name.encode()) << 8 if self.stream is None else self.stream
        return record_of_numbers({**self.numbers(robot), "stream": stream})
