"""Running moments: mean and variance of all that was seen so far."""

import numpy as np

from aerial_il.algorithms.run.state import Part
from aerial_il.policies.parts.normaliser import Normaliser, hardly_varies


class RunningMoments(Part):
    """Mean and variance of all samples so far, as if all of it had been kept.

    Source: T. Chan, G. Golub, R. LeVeque, "Updating Formulae and a Pairwise Algorithm for Computing Sample Variances",
    1979.

    Args:
        size: elements D.
    """

    changing = ("mean", "square", "count")

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
        """(D,) standard deviation; where next to nothing varies yet 1, or the size of the mean if that is larger."""
        deviation, size = np.sqrt(self.square / max(1, self.count)), np.abs(self.mean)
        return np.where(hardly_varies(deviation, size + deviation), np.maximum(size, 1.0), deviation)

    def normaliser(self) -> Normaliser:
        """Return the normaliser to mean 0 and standard deviation 1."""
        return Normaliser(self.mean.astype(np.float32), self.deviation.astype(np.float32))
