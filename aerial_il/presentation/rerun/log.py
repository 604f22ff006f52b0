"""Where things are logged: below an entity of a stream, at the times of a flight."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from aerial_il.presentation.rerun.clock import Clock


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
