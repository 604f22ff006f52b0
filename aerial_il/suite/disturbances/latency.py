"""Latency: actions that arrive late by a whole number of control steps of 20 ms, the same for a whole episode."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.kernels import kernel
from aerial_il.suite.disturbances.disturbance import Disturbance, Start, Strength

MAX_DELAY = 8  # control steps
TIER_DELAY = 2  # the most in a tier of the suite, for which every episode's memory has room
MAX_ACTION = 16  # numbers of the longest action
DELAY, QUEUE = 0, 1  # control steps; then the actions on their way, the next one to arrive first


@dataclass(frozen=True)
class Latency(Disturbance):
    """Actions that arrive late by a whole number of control steps of 20 ms, the same for a whole episode.

    Attributes:
        least, most: control steps.

    Raises:
        InvalidValueError: they are none of 0 to 8, or not in this order; an action that is too long to be late.
    """

    least: int = 1
    most: int = 2
    strength: ClassVar[Strength | None] = Strength("control steps of 20 ms, in every episode", 0.0, MAX_DELAY)

    def __post_init__(self) -> None:
        if not 0 <= self.least <= self.most <= MAX_DELAY:
            raise InvalidValueError(
                f"Actions are late by {self.least} to {self.most} control steps; 0 to {MAX_DELAY} are possible."
            )

    @classmethod
    def of(cls, strength: float) -> Latency:
        if strength != round(strength):
            raise InvalidValueError(f"A latency of {strength:g} control steps is not possible; give a whole number.")
        return cls(int(strength), int(strength))

    @property
    def memory(self) -> int:  # type: ignore[override]
        return 1 + max(TIER_DELAY, self.most) * MAX_ACTION

    def start(self, at: Start) -> np.ndarray:
        memory, stay = np.zeros(self.memory), at.hold_action()
        if stay.size > MAX_ACTION:
            raise InvalidValueError(f"Late actions have {MAX_ACTION} numbers at most, these have {stay.size}.")
        memory[DELAY] = at.rng.integers(self.least, self.most + 1)
        memory[QUEUE:].reshape(-1, MAX_ACTION)[:, : stay.size] = stay
        return memory

    def drawn(self, memory: np.ndarray) -> dict[str, Any]:
        return {"latency_steps": int(memory[DELAY])}


TIERS = {"hard": Latency()}


@kernel
def arrive(own, memory, now, action):
    """Take in the action that is sent and hand out the one that arrives."""
    waiting = int(memory[DELAY])
    for k in range(action.size if waiting > 0 else 0):
        sent, action[k] = action[k], memory[QUEUE + k]
        for j in range(waiting):
            place = QUEUE + j * MAX_ACTION + k
            memory[place] = memory[place + MAX_ACTION] if j + 1 < waiting else sent
