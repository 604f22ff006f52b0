"""The coin of classic DAgger: the expert flies with a probability that falls from round to round.

Whoever wins a toss flies for a while. Tossed anew in every step, as in the paper, the coin holds a robot between two
pilots that want different things: neither the learner's states nor the expert's recoveries come about.

Source: S. Ross, G. Gordon and D. Bagnell, "A reduction of imitation learning and structured prediction to no-regret
online learning", AISTATS 2011: algorithm 3.1.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from aerial_il.algorithms.interactive.gates.gate import GateSettings, Round
from aerial_il.algorithms.interactive.mixture import Decision, Gate, GateInput
from aerial_il.core.checks import require_choice, require_positive, require_share
from aerial_il.core.seeding import restarted

Beta = Literal["exponential", "linear", "zero"]


@dataclass(frozen=True, kw_only=True)
class CoinGate(GateSettings):
    """Classic DAgger: every state is labelled; the expert flies with probability beta.

    Attributes:
        beta: ``exponential`` (decay to the power of the round), ``linear`` (from 1 to 0 over some rounds), or ``zero``
            (1 in round 0, which is the demonstrations, and 0 afterwards).
        decay: of the exponential schedule, in [0, 1].
        over: rounds of the linear schedule.
        hold: control steps until the coin is tossed again; 1 is the paper's.
    """

    beta: Beta = "exponential"
    decay: float = 0.7
    over: int = 15
    hold: int = 25

    def __post_init__(self) -> None:
        require_choice(self, "beta", Beta)
        require_share(self, "decay")
        require_positive(self, "over", "hold")

    def share(self, number: int) -> float:
        """Return beta in round ``number``: 1 in round 0, never rising."""
        if self.beta == "exponential":
            return self.decay**number
        return max(0.0, 1.0 - number / self.over) if self.beta == "linear" else float(number == 0)

    def metrics(self, number: int) -> dict[str, float]:
        return {"beta": self.share(number)}

    def open(self, of: Round) -> Gate:
        return _Coin(self.share(of.number), self.hold, of.seed, of.number)


class _Coin:
    """Tosses a coin per world every ``hold`` steps; each episode has a stream of its own."""

    def __init__(self, beta: float, hold: int, seed: int, number: int) -> None:
        self._beta, self._hold, self._names = beta, hold, ("dagger coin", str(seed), str(number))
        self._rngs: list[np.random.Generator] = []
        self._steps, self._expert_flies = np.zeros(0, int), np.zeros(0, bool)

    def begin(self, seeds: np.ndarray, mask: np.ndarray) -> None:
        if len(self._rngs) != len(seeds):
            self._steps, self._expert_flies = np.zeros(len(seeds), int), np.zeros(len(seeds), bool)
        self._rngs, _ = restarted(self._rngs, seeds, mask, *self._names)
        self._steps[mask] = 0

    def decide(self, given: GateInput) -> Decision:
        for world in np.flatnonzero(self._steps % self._hold == 0):
            self._expert_flies[world] = self._rngs[world].random() < self._beta
        self._steps += 1
        return Decision(self._expert_flies.copy(), np.ones(len(self._steps), bool))
