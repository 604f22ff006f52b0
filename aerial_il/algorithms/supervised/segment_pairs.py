"""Training sets of pairs of segments, of which the first one is preferred."""

import hashlib
from collections.abc import Sequence

import numpy as np
from torch import Tensor

from aerial_il.algorithms.supervised.training_set import TrainingSet
from aerial_il.data.episode import Episode
from aerial_il.data.preferences.pairs import Pair, Preference, Segment
from aerial_il.data.windows import Windows
from aerial_il.policies.parts.layout import Interface
from aerial_il.policies.parts.network import Shown


class SegmentPairs(TrainingSet):
    """Pairs of segments as normalised tensors; equal ones stand in it twice, either way round, at half the weight.

    Args:
        demos: the episodes. windows: of all their steps, in their order. preferences: of segments of theirs.
        interface: how windows are normalised. steps: of a segment that are looked at, evenly spread over it.
        device: where the tensors go.

    Attributes:
        weights: (P,) of each pair. length: mean number of steps of a segment.
        digest: SHA-256 of all pairs.
    """

    def __init__(
        self,
        demos: Sequence[Episode],
        windows: Windows,
        preferences: Sequence[Preference],
        interface: Interface,
        *,
        steps: int,
        device: str,
    ) -> None:
        super().__init__(windows, interface, device)
        starts = np.cumsum(windows.lengths) - windows.lengths
        start_of = {demo.uid: int(start) for demo, start in zip(demos, starts, strict=True)}
        ordered = [(pair, weight) for each in preferences for pair, weight in _ordered(each)]
        self._rows = np.array([[_rows(segment, start_of, steps) for segment in pair] for pair, _ in ordered])
        self.weights = np.array([weight for _, weight in ordered])
        self.length = float(np.mean([segment.length for pair, _ in ordered for segment in pair]))
        self.digest = hashlib.sha256(self._rows.tobytes() + self.weights.tobytes()).hexdigest()

    def __len__(self) -> int:
        return len(self._rows)

    def gather(self, index: np.ndarray) -> tuple[Shown, Tensor, Tensor]:
        """Return the windows (B * 2 * K) of pairs ``index`` (B,), of each one those of its preferred segment first.

        :meth:`by_segment` takes what a network makes of them apart again.
        """
        return super().gather(self._rows[index].reshape(-1))

    def by_segment(self, values: Tensor) -> tuple[Tensor, Tensor]:
        """Return the mean of ``values`` (B * 2 * K,) over preferred segments, and over the others, (B,) each."""
        better, worse = values.unflatten(0, (-1, *self._rows.shape[1:])).mean(-1).unbind(1)
        return better, worse


def _ordered(preference: Preference) -> list[tuple[Pair, float]]:
    """Return the pair with the preferred segment first, or of equal ones both orders; and the weight of each."""
    left, right = preference.pair
    if preference.preferred == "equal":
        return [((left, right), 0.5), ((right, left), 0.5)]
    return [((left, right) if preference.preferred == "left" else (right, left), 1.0)]


def _rows(segment: Segment, start_of: dict[str, int], steps: int) -> np.ndarray:
    """Return the windows (K,) of a segment's steps that are looked at."""
    within = (np.arange(steps) + 0.5) * segment.length / steps
    return start_of[segment.uid] + segment.first + within.astype(int)
