"""Rate: actions that reach the robot less often than every control step; between two of them the last one holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.kernels import kernel
from aerial_il.robots.robot import Robot
from aerial_il.suite.disturbances.disturbance import Disturbance, Start, Strength
from aerial_il.suite.disturbances.latency import MAX_ACTION
from aerial_il.suite.timing import CONTROL_DT_S

LEAST_HZ, MOST_HZ = 2.0, round(1.0 / CONTROL_DT_S)
COUNTED, HELD = 0, 1  # control steps since the last action; then that action


@dataclass(frozen=True)
class Rate(Disturbance):
    """Actions that reach the robot every ``every``-th control step of 20 ms; between two of them the last one holds.

    A policy is asked in every step all the same, as if somebody passed on only some of its answers.

    Attributes:
        every: control steps from one action to the next.

    Raises:
        InvalidValueError: it is below 1, or an action is too long to be held.
    """

    every: int = 2
    strength: ClassVar[Strength | None] = Strength("Hz at which actions reach the robot, of 50", LEAST_HZ, MOST_HZ)
    memory: ClassVar[int] = 1 + MAX_ACTION

    def __post_init__(self) -> None:
        if self.every < 1:
            raise InvalidValueError(f"Actions reach the robot every {self.every} control steps; 1 is the least.")

    @classmethod
    def of(cls, strength: float) -> Rate:
        every = round(MOST_HZ / strength)
        if abs(MOST_HZ / every - strength) > 0.01 * strength:
            near = " or ".join(f"{MOST_HZ / steps:.3g}" for steps in sorted({max(1, every - 1), every, every + 1}))
            raise InvalidValueError(f"A rate of {strength:g} Hz is no whole number of control steps of 20 ms: {near}.")
        return cls(every)

    def start(self, at: Start) -> np.ndarray:
        memory, stay = np.zeros(self.memory), at.hold_action()
        if stay.size > MAX_ACTION:
            raise InvalidValueError(f"Actions that are held have {MAX_ACTION} numbers at most, these have {stay.size}.")
        memory[HELD : HELD + stay.size] = stay
        return memory

    def about(self, robot: Robot) -> dict[str, Any]:
        return {"rate_hz": MOST_HZ / self.every}


TIERS: dict[str, Rate] = {}


@kernel
def arrive(own, memory, now, action):
    """Let every so many actions through, and hold the last one otherwise."""
    passes = memory[COUNTED] == 0.0
    memory[COUNTED] = (memory[COUNTED] + 1.0) % own.every
    for k in range(action.size):
        if passes:
            memory[HELD + k] = action[k]
        else:
            action[k] = memory[HELD + k]
