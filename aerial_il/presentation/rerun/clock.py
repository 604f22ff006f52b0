"""The timelines of a flight in rerun: steps, simulated seconds, and a third one where flights are aligned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import rerun as rr

STEP, SIM_TIME, ALIGNED = "step", "sim_time", "aligned"


@dataclass(frozen=True, eq=False)
class Clock:
    """When each of N states was.

    Attributes:
        sim_time: (N,) s. aligned: (N,) s, when it would have been in another flight; None for a flight alone.
        first_step: number of the first state.
    """

    sim_time: np.ndarray
    aligned: np.ndarray | None = None
    first_step: int = 0

    def columns(self, index: np.ndarray | None = None) -> list[rr.TimeColumn]:
        """Return the time columns of the states ``index``, or of all."""
        index = np.arange(len(self.sim_time)) if index is None else index
        found = [
            rr.TimeColumn(STEP, sequence=self.first_step + index),
            rr.TimeColumn(SIM_TIME, duration=self.sim_time[index]),
        ]
        return found if self.aligned is None else [*found, rr.TimeColumn(ALIGNED, duration=self.aligned[index])]
