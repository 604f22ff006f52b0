"""Chunks that a policy predicts along a flight, beside the actions that were flown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import rerun as rr

from aerial_il.presentation.rerun import palette
from aerial_il.presentation.rerun.clock import Clock

RADIUS_M = 0.005


@dataclass(frozen=True, eq=False)
class Chunks:
    """A policy's answers to what was observed on the way, none to a flight of its own.

    Attributes:
        actions: (T, Da) chunks one after the other. starts: (C,) steps at which they begin.
    """

    actions: np.ndarray
    starts: np.ndarray


def log_chunks(stream: rr.RecordingStream, root: str, chunks: Chunks, columns: list[int], clock: Clock) -> None:
    """Log each chunk of tool positions, the elements ``columns``, as a path that is seen while the chunk lasts."""
    entity = f"{root}/predicted"
    stream.log(entity, rr.LineStrips3D.from_fields(colors=[palette.PREDICTED], radii=[RADIUS_M]), static=True)
    paths = [part[:, columns] for part in np.split(chunks.actions, chunks.starts[1:])]
    stream.send_columns(entity, clock.columns(chunks.starts), rr.LineStrips3D.columns(strips=paths))
