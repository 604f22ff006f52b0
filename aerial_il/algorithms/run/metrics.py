"""Running means of named numbers between two rows of a run's metrics."""

from collections.abc import Mapping

from aerial_il.algorithms.run.state import Part


class MetricMeans(Part):
    """Sums and counts of named numbers; part of a run's state, so that a resumed run logs the same means."""

    changing = ("_sums",)

    def __init__(self) -> None:
        self._sums: dict[str, list[float]] = {}

    def add(self, values: Mapping[str, float]) -> None:
        """Count one value of each name."""
        for name, value in values.items():
            total = self._sums.setdefault(name, [0.0, 0.0])
            total[0] += value
            total[1] += 1

    def take(self) -> dict[str, float]:
        """Return the means since the last call."""
        means = {name: total / count for name, (total, count) in self._sums.items()}
        self._sums = {}
        return means
