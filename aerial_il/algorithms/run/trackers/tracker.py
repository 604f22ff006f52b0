"""The interface of a tracker: a place outside ``metrics.jsonl`` where people look at the numbers of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol


class Tracker(Protocol):
    """Receives the rows of a run's metrics, from the first one each time the run is opened."""

    def write(self, row: Mapping[str, float]) -> None:
        """Take one row: ``step`` and named finite numbers."""
        ...

    def close(self) -> None:
        """Write what is pending and let go."""
        ...
