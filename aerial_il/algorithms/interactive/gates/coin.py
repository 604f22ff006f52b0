"""The coin of classic DAgger: in each step the expert flies with a probability that falls from round to round.

Source: S. Ross, G. Gordon and D. Bagnell, "A reduction of imitation learning and structured prediction to no-regret
online learning", AISTATS 2011: algorithm 3.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from aerial_il.algorithms.interactive.gates.gate import Round
from aerial_il.algorithms.interactive.mixture import Decision, Gate, GateInput
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng

Beta = Literal["exponential", "linear", "zero"]


@dataclass(frozen=True, kw_only=True)
class CoinGate:
    """Classic DAgger: every state is labelled; in each step the expert flies with probability beta.

    Attributes:
        beta: ``exponential`` (decay to the power of the round), ``linear`` (from 1 to 0 over some rounds), or ``zero``
            (1 in round 0, which is the demonstrations, and 0 afterwards).
        decay: of the exponential schedule, in [0, 1].
        over: rounds of the linear schedule.
    """

    beta: Beta = "exponential"
    decay: float = 0.7
    over: int = 15

    def __post_init__(self) -> None:
        if self.beta not in get_args(Beta):
            raise InvalidValueError(f"Unknown beta schedule {self.beta!r}. Valid: {', '.join(get_args(Beta))}.")
        if not 0 <= self.decay <= 1:
            raise InvalidValueError(f"decay is {self.decay}; a share of flying that decays lies in [0, 1].")
        if self.over < 1:
            raise InvalidValueError(f"over is {self.over}; a linear schedule takes at least 1 round.")

    @property
    def ensemble(self) -> int:
        return 1

    @property
    def alone(self) -> int:
        return 0

    def share(self, number: int) -> float:
        """Return beta in round ``number``: 1 in round 0, never rising."""
        if self.beta == "exponential":
            return self.decay**number
        return max(0.0, 1.0 - number / self.over) if self.beta == "linear" else float(number == 0)

    def open(self, of: Round) -> Gate:
        return _Coin(self.share(of.number), of.seed, of.number)


class _Coin:
    """Tosses a coin per world and step; each episode has a stream of its own."""

    def __init__(self, beta: float, seed: int, number: int) -> None:
        self._beta, self._names = beta, ("dagger coin", str(seed), str(number))
        self._rngs: list[np.random.Generator] = []

    def begin(self, seeds: np.ndarray, mask: np.ndarray) -> None:
        fresh = [named_rng(int(seed), *self._names) for seed in seeds]
        kept = fresh if len(self._rngs) != len(seeds) else self._rngs
        self._rngs = [new if due else old for new, old, due in zip(fresh, kept, mask, strict=True)]

    def decide(self, given: GateInput) -> Decision:
        tossed = np.array([rng.random() for rng in self._rngs])
        return Decision(tossed < self._beta, np.ones(len(tossed), bool))
