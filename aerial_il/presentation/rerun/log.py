"""Where things are logged: below an entity of a stream, at the times of a flight."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

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
        times = [
            rr.TimeColumn(STEP, sequence=self.first_step + index),
            rr.TimeColumn(SIM_TIME, duration=self.sim_time[index]),
        ]
        return times if self.aligned is None else [*times, rr.TimeColumn(ALIGNED, duration=self.aligned[index])]


@dataclass(frozen=True, eq=False)
class Log:
    """An entity of a stream.

    Attributes:
        stream: of rerun. root: the entity below which all lies. clock: the times of what changes.
        second: whether it belongs to a second flight, whose curves are paler than the first's.
    """

    stream: rr.RecordingStream
    root: str
    clock: Clock
    second: bool = False

    def static(self, entity: str, what: rr.AsComponents | Iterable[rr.DescribedComponentBatch]) -> None:
        """Log below the root what holds at all times."""
        self.stream.log(f"{self.root}/{entity}", what, static=True)

    def send(self, entity: str, columns: Any, index: np.ndarray | None = None) -> None:
        """Log below the root the rows of the states ``index``, or of all."""
        self.stream.send_columns(f"{self.root}/{entity}", self.clock.columns(index), columns)
