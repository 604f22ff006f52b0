"""Generalised advantages, and the normalisation of rewards by the running moments of returns."""

from __future__ import annotations

import numpy as np

from aerial_il.algorithms.online.moments import RunningMoments
from aerial_il.algorithms.run.state import Snapshot


def gae(
    rewards: np.ndarray,
    values: np.ndarray,
    next_values: np.ndarray,
    ended: np.ndarray,
    *,
    gamma: float,
    gae_lambda: float,
) -> np.ndarray:
    """Return generalised advantage estimates (T, n).

    ``A_t = delta_t + gamma * gae_lambda * (1 - ended_t) * A_{t+1}`` with
    ``delta_t = r_t + gamma * V(s'_t) - V(s_t)``, where ``s'_t`` is what was seen before any reset.

    Args:
        rewards, values: (T, n) ``r_t`` and ``V(s_t)``.
        next_values: (T, n) ``V(s'_t)``: the critic's where the episode goes on or was only truncated, so that a time
            limit does not count as a loss; after a terminal step, the value of that end.
        ended: (T, n) bool, ``s'_t`` was the last of its episode.
        gamma: discount. gae_lambda: lambda.

    Source: J. Schulman et al., "High-Dimensional Continuous Control Using Generalized Advantage Estimation", 2016,
    equation 16; F. Pardo et al., "Time Limits in Reinforcement Learning", 2018, equation 6.
    """
    errors = rewards + gamma * next_values - values
    found, later = np.zeros_like(errors), np.zeros(errors.shape[1:])
    for t in reversed(range(len(errors))):
        later = errors[t] + gamma * gae_lambda * np.where(ended[t], 0.0, later)
        found[t] = later
    return found


class RewardNorm:
    """Divide rewards by the running standard deviation of discounted returns, so that values are of the order of one.

    Args:
        worlds: n. gamma: discount.

    Source: M. Andrychowicz et al., "What Matters for On-Policy Deep Actor-Critic Methods?", 2021, appendix B.9.2.
    """

    def __init__(self, worlds: int, gamma: float) -> None:
        self.moments, self.gamma, self._running = RunningMoments(1), gamma, np.zeros(worlds)

    def scale(self, rewards: np.ndarray, ended: np.ndarray) -> np.ndarray:
        """Take rewards (T, n) in and return them divided; ``ended`` (T, n) bool starts the sums again."""
        sums = np.empty_like(rewards, float)
        for t in range(len(rewards)):
            self._running = self.gamma * self._running + rewards[t]
            sums[t] = self._running
            self._running = np.where(ended[t], 0.0, self._running)
        self.moments.add(sums.reshape(-1, 1))
        return rewards / self.moments.deviation[0]

    def snapshot(self) -> Snapshot:
        inner = self.moments.snapshot()
        return Snapshot({**inner.arrays, "running": self._running.copy()}, inner.values)

    def restore(self, saved: Snapshot) -> None:
        self.moments.restore(saved)
        self._running = saved.arrays["running"].copy()
