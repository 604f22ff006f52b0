"""Lead flights aside as they begin, so that what is learned from shows the way back."""

import numpy as np

from aerial_il.core.seeding import named_rng
from aerial_il.experts.expert import led

STEPS = 50  # in which a flight is led aside
MOST_DISTURBED_M = 0.5  # a tool goes no farther in these


class Diversion:
    """Places beside the starts of n worlds, a place of its own for every episode.

    Args:
        n: worlds. most: m, farthest from the start. seed: of the places, beside that of each episode.

    Attributes:
        left: (n,) steps in which a flight will still be led there.
    """

    def __init__(self, n: int, most: float, seed: int) -> None:
        self._most, self._seed = most, seed
        self.left, self._place = np.zeros(n, int), np.zeros((n, 3))

    def reset(self, mask: np.ndarray) -> None:
        """Begin anew in the worlds of ``mask`` (n,) bool."""
        self.left[mask] = STEPS if self._most else 0

    def sent(self, tool_pos: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        """Return where the tools (n, 3) m of the episodes ``seeds`` (n,) are sent, NaN where they are not led aside."""
        for i in np.flatnonzero(self.left == STEPS):
            rng = named_rng(int(seeds[i]), "diversion", str(self._seed))
            way = rng.standard_normal(3)
            way[2] = abs(way[2])  # what things stand on is below
            self._place[i] = tool_pos[i] + self._most * rng.random() * way / np.linalg.norm(way)
        aside = self.left > 0
        self.left[aside] -= 1
        return np.where(aside[:, None], led(tool_pos, self._place), np.nan)
