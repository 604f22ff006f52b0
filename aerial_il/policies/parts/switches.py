"""Action elements that demonstrations only ever set to one of two values, such as a gripper that is open or closed.

A regression, and more so the mean over overlapping chunks, answers with values between the two, which no
demonstration shows the consequences of: a half-closed gripper that does not hold. Such elements are therefore flown
at the nearer of their two values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Switches:
    """The two values of each switched element.

    Attributes:
        low, high: (Da,) float32 in the action's units; NaN for elements that are not switched.
    """

    low: np.ndarray
    high: np.ndarray

    @staticmethod
    def fit(actions: np.ndarray) -> Switches:
        """Find the elements of demonstrated actions (N, Da) that take exactly two values."""
        low, high = actions.min(axis=0), actions.max(axis=0)
        switched = (low < high) & ((actions == low) | (actions == high)).all(axis=0)
        return Switches(*(np.where(switched, v, np.nan).astype(np.float32) for v in (low, high)))

    @staticmethod
    def none(size: int) -> Switches:
        """No switched element among ``size``."""
        return Switches(np.full(size, np.nan, np.float32), np.full(size, np.nan, np.float32))

    def snap(self, actions: np.ndarray) -> np.ndarray:
        """Return actions (..., Da) with switched elements at the nearer of their two values."""
        nearer = np.where(actions - self.low < self.high - actions, self.low, self.high)
        return np.where(np.isnan(self.low), actions, nearer)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return both arrays by name, to be saved with the policy."""
        return {"switches.low": self.low, "switches.high": self.high}

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray]) -> Switches:
        """Rebuild from :meth:`arrays`."""
        return Switches(arrays["switches.low"], arrays["switches.high"])
