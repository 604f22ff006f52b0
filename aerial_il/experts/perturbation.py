"""A slow wander of commanded positions, so that demonstrations show how to come back."""

import numpy as np

from aerial_il.core.seeding import named_rng

NOISE_M = 0.03  # standard deviation of the position command at full strength
NOISE_TIME_STEPS = 25.0  # its correlation time


class Perturbation:
    """An Ornstein-Uhlenbeck process for each world, a stream of its own for every episode.

    Args:
        n: worlds. strength: 0 to 1. seed: of the streams, beside that of each episode. name: of the streams.
    """

    def __init__(self, n: int, strength: float, seed: int, *, name: str) -> None:
        self.strength, self._seed, self._name = strength, seed, name
        self._offset = np.zeros((n, 3))
        self._rngs: list[np.random.Generator | None] = [None] * n

    def reset(self, mask: np.ndarray) -> None:
        """Begin anew in the worlds of ``mask`` (n,) bool."""
        self._offset[mask] = 0.0
        for i in np.flatnonzero(mask):
            self._rngs[i] = None

    def drawn(self, seeds: np.ndarray) -> np.ndarray:
        """Return the offsets (n, 3) m of the coming step of the episodes ``seeds`` (n,)."""
        decay = np.exp(-1.0 / NOISE_TIME_STEPS)
        kick = np.sqrt(1.0 - decay**2) * NOISE_M * self.strength
        for i, rng in enumerate(self._rngs):
            rng = rng or named_rng(int(seeds[i]), self._name, str(self._seed))
            self._rngs[i] = rng
            self._offset[i] = decay * self._offset[i] + kick * rng.standard_normal(3)
        return self._offset
