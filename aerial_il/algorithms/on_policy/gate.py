"""A gate that keeps the return of a prior: weights that return less than it are given up for the last that did not."""

import copy
import math
from typing import Literal

import numpy as np

from aerial_il.algorithms.run.state import Part
from aerial_il.policies.parts.network import ChunkNetwork

FEWEST = 10  # episodes of the learner, and of the prior, that are compared


class ReturnGate(Part):
    """Compares the mean return of the episodes that ended in a rollout with what the prior's had, both exploring.

    Where fewer than ten have ended, those of further rollouts are added to them first; the prior flies until ten of
    its own have. Episodes that are flown with the prior's weights count as the prior's: in its first steps only those
    end that succeed soon, and a prior that was evaluated on them alone would be overestimated, and never left. Weights
    that were kept, and are found worse when they fly again, are given up for the prior's.

    Args:
        actor: what learns; it starts as the prior. worlds: n.
        errors: standard errors of the difference by which the actor may lie below the prior.
    """

    changing = ("_running", "_prior", "_own", "_keeps", "_first", "_kept", "_flies")

    def __init__(self, actor: ChunkNetwork, worlds: int, errors: float) -> None:
        self._actor, self._errors, self._running = actor, errors, np.zeros(worlds)
        self._first, self._kept = copy.deepcopy(actor), copy.deepcopy(actor)
        self._prior, self._own, self._keeps = (np.zeros(0) for _ in range(3))  # returns of the prior, now, of the kept
        self._flies: Literal["prior", "kept", "new"] = "prior"

    def passes(self, rewards: np.ndarray, ended: np.ndarray, *, warming_up: bool) -> bool:
        """Take in what the actor flew as it is; where it flew worse than the prior, let it be as it was before.

        Args:
            rewards, ended: (T, n) of a rollout's steps. warming_up: whether the prior is to fly on.

        Returns:
            Whether the actor may learn from the rollout: it flew with the weights that it has now, not clearly worse.
        """
        returns = self._ended(rewards, ended)
        if self._flies == "prior":
            self._prior = np.concatenate([self._prior, returns])
            if warming_up or len(self._prior) < FEWEST:
                return False
        else:
            self._own = np.concatenate([self._own, returns])
            if len(self._own) >= FEWEST:
                if self._is_worse():
                    self._fall_back()
                    return False
                self._kept.load_state_dict(self._actor.state_dict())
                self._keeps, self._own = self._own, np.zeros(0)
        self._flies = "new"
        return True

    def _is_worse(self) -> bool:
        own, prior = self._own, self._prior
        error = math.sqrt(own.var() / len(own) + prior.var() / len(prior))
        return bool(own.mean() < prior.mean() - self._errors * error)

    def _fall_back(self) -> None:
        """Let the kept weights fly once more; those of the prior where these have just failed, or where none is."""
        if self._flies == "kept" or not len(self._keeps):
            self._kept.load_state_dict(self._first.state_dict())
            self._keeps, self._flies = np.zeros(0), "prior"
        else:
            self._flies = "kept"
        self._own = self._keeps
        self._actor.load_state_dict(self._kept.state_dict())

    def _ended(self, rewards: np.ndarray, ended: np.ndarray) -> np.ndarray:
        """Return the returns (k,) of the episodes that ended in a rollout, whose rewards and ends (T, n) these are."""
        returns: list[float] = []
        for paid, over in zip(rewards, ended, strict=True):
            self._running = self._running + paid
            returns += self._running[over].tolist()
            self._running = np.where(over, 0.0, self._running)
        return np.array(returns)
