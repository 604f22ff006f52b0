"""Chunks that a policy predicts along a flight, beside the actions that were flown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import rerun as rr

from aerial_il.presentation.rerun import palette
from aerial_il.presentation.rerun.log import Log

RADIUS_M = 0.005


@dataclass(frozen=True, eq=False)
class Chunks:
    """A policy's answers to what was observed on the way, none to a flight of its own.

    Attributes:
        actions: (T, Da) chunks one after the other. starts: (C,) steps at which they begin.
    """

    actions: np.ndarray
    starts: np.ndarray


def log_chunks(log: Log, chunks: Chunks, columns: list[int]) -> None:
    """Log each chunk of tool positions, the elements ``columns``, as a path that is seen while the chunk lasts."""
    log.static("predicted", rr.LineStrips3D.from_fields(colors=[palette.PREDICTED], radii=[RADIUS_M]))
    paths = [part[:, columns] for part in np.split(chunks.actions, chunks.starts[1:])]
    log.send("predicted", rr.LineStrips3D.columns(strips=paths), chunks.starts)
