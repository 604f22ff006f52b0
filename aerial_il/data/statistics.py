"""Normalisation statistics, computed from the data themselves in one exact pass per field."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode

QUANTILES = (0.01, 0.99)


@dataclass(frozen=True)
class Statistics:
    """Statistics of the elements of one field, each array (D,).

    Attributes:
        count: number of samples.
        mean, std, low, high: moments and extremes.
        q01, q99: quantiles, exact rather than merged from parts.
    """

    count: int
    mean: np.ndarray
    std: np.ndarray
    low: np.ndarray
    high: np.ndarray
    q01: np.ndarray
    q99: np.ndarray

    @staticmethod
    def of(samples: np.ndarray) -> Statistics:
        """Compute the statistics of ``samples`` (N, D).

        Raises:
            InvalidValueError: there are none, or one is not finite.
        """
        samples = np.asarray(samples, float).reshape(len(samples), -1)
        if not len(samples) or not np.isfinite(samples).all():
            raise InvalidValueError("Statistics need at least one sample, and only finite ones.")
        q01, q99 = np.quantile(samples, QUANTILES, axis=0)
        extremes = samples.min(0), samples.max(0)
        return Statistics(len(samples), samples.mean(0), samples.std(0), *extremes, q01, q99)


def statistics(episodes: Iterable[Episode]) -> dict[str, Statistics]:
    """Return the statistics of every state field, seen before an action, and of ``action``."""
    samples: dict[str, list[np.ndarray]] = {}
    for episode in episodes:
        for name in episode.spec.observation.state_names:
            samples.setdefault(name, []).append(episode.obs[name][: len(episode)].reshape(len(episode), -1))
        samples.setdefault("action", []).append(episode.actions)
    return {name: Statistics.of(np.concatenate(parts)) for name, parts in samples.items()}
