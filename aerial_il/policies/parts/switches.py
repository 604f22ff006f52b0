"""Action elements that demonstrations set to one of two values, such as a gripper that is open or closed.

A regression, and more so the mean over overlapping chunks, answers with values between the two, which no
demonstration shows the consequences of: a half-closed gripper that does not hold. Such elements are therefore flown
at the nearer of their two values. A third value that an expert rarely uses does not change that, and is never flown: it
would be all the time that the policy is in two minds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from aerial_il.policies.parts.normaliser import Samples

MOST = 4  # values that a switched element may take in all
MAIN_SHARE = 0.95  # of the steps, in which it takes one of its two main ones


@dataclass(frozen=True, eq=False)
class Switches:
    """The two values of each switched element.

    Attributes:
        low, high: (Da,) float32 in the action's units; NaN for elements that are not switched.
    """

    low: np.ndarray
    high: np.ndarray

    @staticmethod
    def fit(actions: np.ndarray | Samples) -> Switches:
        """Find the elements of demonstrated actions (N, Da) that take two values, but for few steps with others.

        A choice among several, shown as a 1 among zeros, is flown by its highest score: none of its elements is a
        switch, or scores below a half would all become zeros.
        """
        samples = Samples.of(actions) if isinstance(actions, np.ndarray) else actions
        size = next(iter(samples)).shape[1]
        if all(map(_is_choice, samples)):
            return Switches.none(size)
        pairs = np.full((size, 2), np.nan, np.float32)
        for element, (values, counts) in _few_values(samples).items():
            main = np.sort(np.argsort(-counts, kind="stable")[:2])
            if len(values) >= 2 and counts[main].sum() >= MAIN_SHARE * counts.sum():
                pairs[element] = values[main]
        return Switches(*pairs.T)

    @staticmethod
    def none(size: int) -> Switches:
        """No switched element among ``size``."""
        return Switches(np.full(size, np.nan, np.float32), np.full(size, np.nan, np.float32))

    def snap(self, actions: np.ndarray) -> np.ndarray:
        """Return actions (..., Da) with switched elements at the nearer of their two values."""
        nearer = np.where(actions - self.low < self.high - actions, self.low, self.high)
        return np.where(np.isnan(self.low), actions, nearer)

    def holding(self, constant: np.ndarray, centre: np.ndarray) -> Switches:
        """Return the same with the elements where ``constant`` (Da,) bool held at ``centre`` (Da,)."""
        return Switches(np.where(constant, centre, self.low), np.where(constant, centre, self.high))

    def arrays(self) -> dict[str, np.ndarray]:
        """Return both arrays by name, to be saved with the policy."""
        return {"switches.low": self.low, "switches.high": self.high}

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray]) -> Switches:
        """Rebuild from :meth:`arrays`."""
        return Switches(arrays["switches.low"], arrays["switches.high"])


def _few_values(samples: Samples) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Return the values, in order, and the count of each, of the elements that take few."""
    found: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    for number, block in enumerate(samples):
        for element in found if number else range(block.shape[1]):
            values, counts = np.unique(block[:, element], return_counts=True)
            if number:
                values, counts = _merged(*found[element], values, counts)
            found[element] = values, counts
        found = {element: each for element, each in found.items() if len(each[0]) <= MOST}
    return found


def _merged(
    values: np.ndarray, counts: np.ndarray, others: np.ndarray, more: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return all values and the count of each."""
    every, places = np.unique(np.concatenate([values, others]), return_inverse=True)
    return every, np.bincount(places, np.concatenate([counts, more]), len(every)).astype(int)


def _is_choice(actions: np.ndarray) -> bool:
    """Whether each of the actions (N, Da) is a 1 among zeros."""
    several = actions.shape[1] > 1
    return several and bool(np.isin(actions, (0, 1)).all() and (actions.sum(axis=1) == 1).all())
