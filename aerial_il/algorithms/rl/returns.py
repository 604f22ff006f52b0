"""Generalised advantages, running moments, and the normalisation of rewards by them."""

from __future__ import annotations

import numpy as np

from aerial_il.algorithms.run.state import Snapshot
from aerial_il.policies.parts.normaliser import MIN_SCALE, Normaliser


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


class RunningMoments:
    """Mean and variance of all samples so far, as if all of it had been kept.

    Source: T. Chan, G. Golub, R. LeVeque, "Updating Formulae and a Pairwise Algorithm for Computing Sample Variances",
    1979.

    Args:
        size: elements D.
    """

    def __init__(self, size: int) -> None:
        self.count, self.mean, self.square = 0, np.zeros(size), np.zeros(size)  # square: sum of squared deviations

    def add(self, samples: np.ndarray) -> None:
        """Take samples (N, D) in."""
        count, mean = len(samples), samples.mean(axis=0, dtype=np.float64)
        total, away = self.count + count, mean - self.mean
        self.square = self.square + ((samples - mean) ** 2).sum(axis=0) + away**2 * self.count * count / total
        self.mean, self.count = self.mean + away * count / total, total

    @property
    def deviation(self) -> np.ndarray:
        """(D,) standard deviation, 1 where nothing varies yet."""
        found = np.sqrt(self.square / max(1, self.count))
        return np.where(found < MIN_SCALE, 1.0, found)

    def normaliser(self) -> Normaliser:
        """Return the normaliser to mean 0 and standard deviation 1."""
        return Normaliser(self.mean.astype(np.float32), self.deviation.astype(np.float32))

    def snapshot(self) -> Snapshot:
        return Snapshot({"mean": self.mean.copy(), "square": self.square.copy()}, {"count": self.count})

    def restore(self, saved: Snapshot) -> None:
        self.mean, self.square = saved.arrays["mean"].copy(), saved.arrays["square"].copy()
        self.count = saved.values["count"]


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
