"""A gate that keeps the return of a prior: weights that return less than it are given up for the last that did not."""

from __future__ import annotations

import math

import numpy as np

from aerial_il.algorithms.decisions.rollout import Decisions, Returns
from aerial_il.algorithms.run.state import Snapshot
from aerial_il.algorithms.run.train_state import load_weights, weights_of
from aerial_il.policies.parts.network import ChunkNetwork

FEWEST = 10  # episodes of a rollout, and of the prior, that are compared at all


class ReturnGate:
    """Compares the mean return of the episodes that ended in a rollout with what the prior's had, both exploring.

    Episodes that are flown with the prior's weights count as the prior's: in its first steps only those end that
    succeed soon, and a prior that was evaluated on them alone would be overestimated, and never left.

    Args:
        actor: what learns; it starts as the prior. worlds: n.
        errors: standard errors of the difference by which the actor may lie below the prior.
    """

    def __init__(self, actor: ChunkNetwork, worlds: int, errors: float) -> None:
        self._actor, self._errors, self._returns = actor, errors, Returns(worlds)
        self._prior = np.zeros(0)
        self._kept, self._begins, self._keeps_prior = self._weights(), True, True

    def passes(self, decisions: Decisions, *, warming_up: bool) -> bool:
        """Take in what the actor flew as it is; where it flew worse than the prior, let it be as it was before.

        Returns:
            Whether the actor may learn from the rollout: it flew with the weights that it has now, not clearly worse.
        """
        returns = self._returns.ended(decisions)
        if self._begins:
            self._prior = np.concatenate([self._prior, returns])
        elif self._is_worse(returns):
            load_weights(self._actor, self._kept)
            self._begins = self._keeps_prior
            return False
        if warming_up:
            return False
        self._kept, self._keeps_prior, self._begins = self._weights(), self._begins, False
        return True

    def _is_worse(self, returns: np.ndarray) -> bool:
        if min(len(returns), len(self._prior)) < FEWEST:
            return False
        error = math.sqrt(returns.var() / len(returns) + self._prior.var() / len(self._prior))
        return bool(returns.mean() < self._prior.mean() - self._errors * error)

    def _weights(self) -> dict[str, np.ndarray]:
        return {name: array.copy() for name, array in weights_of(self._actor).items()}

    def snapshot(self) -> Snapshot:
        kept = {f"kept.{name}": array for name, array in self._kept.items()}
        told = {"begins": self._begins, "keeps_prior": self._keeps_prior}
        return Snapshot({**self._returns.snapshot().arrays, "prior": self._prior.copy(), **kept}, told)

    def restore(self, saved: Snapshot) -> None:
        self._returns.restore(saved)
        self._prior = saved.arrays["prior"].copy()
        self._begins, self._keeps_prior = (saved.values.get(name, False) for name in ("begins", "keeps_prior"))
        self._kept = {name: saved.arrays[f"kept.{name}"].copy() for name in self._kept}
