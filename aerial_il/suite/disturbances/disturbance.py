"""What a disturbance is: settings, strengths per tier, a memory in the world's state, and kernels in the flight loop.

A file in this folder defines a frozen dataclass that is called as the file, a mapping ``TIERS`` of the tiers that have
it with its strength there, and, each if it needs it, compiled functions

    arrive(own, memory, now, action)   once a control step, before the controller reads it: changes the action
    advance(own, memory, now)          once a control step: changes the memory
    act(own, memory, now, effects)     each physics step, and when the robot is observed: adds to the effects

``own`` is a record of what :meth:`Disturbance.numbers` returns, with ``stream``, the first of its channels of random
numbers; ``memory`` (memory,) belongs to the state; ``now`` and ``effects`` are records of ``physics.hooks``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any, ClassVar, NamedTuple
from zlib import crc32

import numpy as np

from aerial_il.core.addresses import record_of_numbers
from aerial_il.core.errors import InvalidValueError
from aerial_il.robots.robot import Robot
from aerial_il.suite.disturbances.nominal import SEEN, Nominal


class Start(NamedTuple):
    """What a disturbance may look at when an episode starts.

    Attributes:
        rng: of its own, the same for an episode in every tier. hold_action: returns the action (Da,) that keeps the
            robot where it is.
    """

    rng: np.random.Generator
    hold_action: Callable[[], np.ndarray]


class Strength(NamedTuple):
    """What one number, the strength of a disturbance, means.

    Attributes:
        meaning: a clause. least, most: its limits.
    """

    meaning: str
    least: float
    most: float


class Disturbance:
    """Settings of one disturbance: frozen dataclasses inherit from it.

    Attributes:
        strength: what its strength means, where one number says it all.
        memory: numbers of a world's state that are its own. varies: fields that it changes, see ``Nominal.field``.
        stream: first channel of its random numbers; None for one by its name.
    """

    strength: ClassVar[Strength | None] = None
    memory: ClassVar[int] = 0
    varies: ClassVar[tuple[str, ...]] = ()
    stream: ClassVar[int | None] = None

    @classmethod
    def of(cls, strength: float) -> Disturbance:
        """Return the disturbance of a strength, which lies within the limits of :attr:`strength`.

        Raises:
            InvalidValueError: it lies between those that are possible, e.g. half a control step.
        """
        raise InvalidValueError(f"{cls.__name__} has no strength that one number says.")

    def unfelt(self, robot: Robot) -> str | None:
        """Return why ``robot`` would not notice it at any strength, or None if it would."""
        return None

    @property
    def seen_alone(self) -> bool:
        """Whether nothing of it is noticed but by cameras."""
        return bool(self.varies) and SEEN.issuperset(self.varies)

    def numbers(self, robot: Robot) -> dict[str, float]:
        """Return what the kernels read, by name: the settings, or what they amount to on a robot."""
        return asdict(self)  # type: ignore[call-overload]

    def start(self, at: Start) -> np.ndarray:
        """Return the memory (memory,) with which an episode starts."""
        return np.zeros(self.memory)

    def drawn(self, memory: np.ndarray) -> dict[str, Any]:
        """Return what an episode that starts with this memory has drawn, as plain values with units in their names."""
        return {}

    def vary(self, fields: dict[str, np.ndarray], nominal: Nominal, rng: np.random.Generator) -> dict[str, Any]:
        """Change the model of an episode in place and return what was drawn, as plain values.

        Args:
            fields: of :attr:`varies`, by name, as the nominal model has them or others have left them.
        """
        return {}

    def about(self, robot: Robot) -> dict[str, Any]:
        """Return what the settings amount to on a robot, for people, with units in the names."""
        return {}

    def record(self, name: str, robot: Robot) -> np.ndarray:
        """Return ``own`` (1,) of the kernels of the disturbance that is registered as ``name``."""
        stream = crc32(name.encode()) << 8 if self.stream is None else self.stream
        return record_of_numbers({**self.numbers(robot), "stream": stream})
