"""Generalised advantages of decisions, which last a step or several, and the normalisation of rewards."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from torch import Tensor

from aerial_il.algorithms.online.moments import RunningMoments


class Advantages(NamedTuple):
    """B decisions: obs, next_obs (B, Do), raw (B, R), advantages (B,) and the critic's targets (B,)."""

    obs: Tensor
    next_obs: Tensor
    raw: Tensor
    advantages: Tensor
    targets: Tensor

    @property
    def standardised(self) -> Tensor:
        """(B,) advantages of mean 0 and standard deviation 1."""
        return (self.advantages - self.advantages.mean()) / (self.advantages.std() + 1e-8)

    def rows(self, which: Tensor) -> Advantages:
        """Return those of some rows."""
        return Advantages(*(column[which] for column in self))


class Judged(NamedTuple):
    """Every decision of a rollout as a learner takes it, and the mean value of the states they were made in."""

    data: Advantages
    value: float


def gae(
    rewards: np.ndarray,
    values: np.ndarray,
    next_values: np.ndarray,
    ended: np.ndarray,
    decided: np.ndarray,
    *,
    gamma: float,
    gae_lambda: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return generalised advantages (T, n) where decisions were made, and the step (T, n) at which each one closed.

    ``A_t = R_t + gamma^k V(s'_{t+k}) - V(s_t) + gamma^k lambda A_{t+k}``, where the decision of step t lasted k steps
    with ``R_t`` as the sum of their discounted rewards, and ``s'`` is what was seen before any reset. A decision that
    is cut by a time limit, or by the end of the rollout, bootstraps from the critic there.

    Args:
        rewards, values: (T, n) ``r_t`` and ``V(s_t)``.
        next_values: (T, n) ``V(s'_{t+1})``: the critic's where the episode goes on or was only truncated, so that a
            time limit does not count as a loss; after a terminal step, the value of that end.
        ended: (T, n) bool, the step was the last of its episode. decided: (T, n) bool, a decision starts here.
        gamma: discount of a step. gae_lambda: lambda, counted in decisions.

    Source: J. Schulman et al., "High-Dimensional Continuous Control Using Generalized Advantage Estimation", 2016,
    equation 16; F. Pardo et al., "Time Limits in Reinforcement Learning", 2018, equation 6; R. Sutton, D. Precup,
    S. Singh, "Between MDPs and semi-MDPs", 1999, section 3, for decisions that last.
    """
    steps, worlds = rewards.shape
    advantages, closing = np.zeros((steps, worlds)), np.zeros((steps, worlds), np.int64)
    paid, left, later = np.zeros(worlds), np.ones(worlds), np.zeros(worlds)
    closed_at = np.zeros(worlds, np.int64)
    for t in reversed(range(steps)):
        closes = ended[t] | (decided[t + 1] if t + 1 < steps else True)
        paid = rewards[t] + np.where(closes, gamma * next_values[t], gamma * paid)
        left, later = gamma * np.where(closes, 1.0, left), np.where(ended[t], 0.0, later)
        closed_at = np.where(closes, t, closed_at)
        advantages[t] = np.where(decided[t], paid - values[t] + gae_lambda * left * later, 0.0)
        closing[t], later = closed_at, np.where(decided[t], advantages[t], later)
    return advantages, closing


class RewardNorm(RunningMoments):
    """Divide rewards by the running standard deviation of discounted returns, so that values are of the order of one.

    Args:
        worlds: n. gamma: discount.

    Source: M. Andrychowicz et al., "What Matters for On-Policy Deep Actor-Critic Methods?", 2021, appendix B.9.2.
    """

    changing = (*RunningMoments.changing, "_running")

    def __init__(self, worlds: int, gamma: float) -> None:
        super().__init__(1)
        self.gamma, self._running = gamma, np.zeros(worlds)

    def scale(self, rewards: np.ndarray, ended: np.ndarray) -> np.ndarray:
        """Take rewards (T, n) in and return them divided; ``ended`` (T, n) bool starts the sums again."""
        sums = np.empty_like(rewards, float)
        for t in range(len(rewards)):
            self._running = self.gamma * self._running + rewards[t]
            sums[t] = self._running
            self._running = np.where(ended[t], 0.0, self._running)
        self.add(sums.reshape(-1, 1))
        return rewards / self.deviation[0]
