"""The best checkpoint of a run, by its evaluations so far, and how long none has been better."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

LOWER_IS_BETTER = ("crashes", "dropped", "time_to_success_s")


@dataclass(frozen=True)
class BestCheckpoint:
    """The best of a run's evaluations so far, read from its metrics alone, so that a resumed run decides alike.

    Attributes:
        value: highest value, or the lowest of what had better be low. step: where it was reached, for the last time.
        stale: evaluations since it was reached for the first time.
        evaluations: how many there were.
    """

    value: float
    step: int
    stale: int
    evaluations: int

    @staticmethod
    def of(rows: Iterable[Mapping[str, float]], name: str) -> BestCheckpoint | None:
        """Compare by the number called ``name``; None where no row has it."""
        found = [(row[name], int(row["step"])) for row in rows if name in row]
        if not found:
            return None
        sign = -1.0 if name.rpartition("/")[2] in LOWER_IS_BETTER else 1.0
        merits = [-math.inf if math.isnan(value) else sign * value for value, _ in found]
        place = merits.index(max(merits))
        step = max(step for merit, (_, step) in zip(merits, found, strict=True) if merit == merits[place])
        return BestCheckpoint(found[place][0], step, len(found) - 1 - place, len(found))
