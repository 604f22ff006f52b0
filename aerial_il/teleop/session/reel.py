"""The states of an episode, kept to be looked at again: all of a short one, evenly spaced ones of a long one."""

import numpy as np

MOST_STATES = 600  # one and a half megabytes or so


class Reel:
    """Keeps at most so many states, however long the episode grows.

    Args:
        most: states; when there are more, every second one goes, and from then on fewer are kept.
    """

    def __init__(self, most: int = MOST_STATES) -> None:
        self._most, self._stride, self._count = most, 1, 0
        self._states: list[np.ndarray] = []

    def __len__(self) -> int:
        return len(self._states)

    def keep(self, state: np.ndarray) -> None:
        """Take the next state (S,) of the episode."""
        if self._count % self._stride == 0:
            self._states.append(state)
        self._count += 1
        if len(self._states) > self._most:
            self._states, self._stride = self._states[::2], 2 * self._stride

    def at(self, share: float) -> np.ndarray | None:
        """Return the state (S,) at a share of the episode in [0, 1]; None where nothing was kept."""
        return self._states[round(share * (len(self) - 1))] if self._states else None
