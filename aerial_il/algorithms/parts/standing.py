"""How a run's rollouts stand: which evaluation was the best one, and whether to go on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Standing:
    """The evaluations of a run so far, told from its metrics alone, so that a resumed run decides alike.

    Attributes:
        best: highest value; step: where it was reached, the last time if it was reached again.
        stale: evaluations since it was reached for the first time.
        evaluations: how many there were.
    """

    best: float
    step: int
    stale: int
    evaluations: int

    @staticmethod
    def of(rows: Iterable[Mapping[str, float]], name: str) -> Standing | None:
        """Judge by the number called ``name``; None where no row has it."""
        told = [(row[name], int(row["step"])) for row in rows if name in row]
        if not told:
            return None
        values = [value for value, _ in told]
        best = max(values)
        step = max(step for value, step in told if value == best)
        return Standing(best, step, len(values) - 1 - values.index(best), len(values))
