"""What the rows of a field are, by their shape and type: pictures, depth, or numbers; and how they are held here."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from aerial_il.core.specs import Group
from aerial_il.data.source import Rows

MILLIMETRE = 1e-3
SMALLEST = 8  # pixels a side of what is a picture although its type does not tell


class Kind(NamedTuple):
    """What a field holds: colour (H, W, 3) uint8, depth (H, W) float32 m, or numbers float64.

    ``first``: the channels of its rows come first in the file. ``scale``: by which depth is multiplied; whole numbers
    are millimetres, as depth cameras give them (ROS REP 118).
    """

    shape: tuple[int, ...]
    group: Group
    dtype: str
    first: bool = False
    scale: float = 1.0

    @staticmethod
    def of(values: Rows, group: Group = "proprio") -> Kind:
        """Return what ``values`` (T, ...) are; numbers belong to ``group``."""
        row, kind = tuple(values.shape[1:]), values.dtype.kind
        if not row:
            return Kind((1,), group, "float64")
        sized = [side for side in row if side >= SMALLEST]
        pictured = len(sized) >= 2 and kind in "uf" and values.dtype != np.uint32
        if len(row) == 3 and (pictured or values.dtype == np.uint8):
            first = row[0] in (1, 3, 4) and row[2] not in (1, 3, 4)
            height, width, channels = (*row[1:], row[0]) if first else row
            if channels in (3, 4):
                return Kind((height, width, 3), "image", "uint8", first)
            if channels == 1:
                return _grey((height, width), values.dtype, first)
        if len(row) == 2 and pictured:
            return _grey(row, values.dtype)
        return Kind(row, group, "float64")

    def held(self, values: np.ndarray) -> np.ndarray:
        """Return ``values`` (T, ...) of this kind as they are held: colours that are floats as bytes.

        Raises:
            ValueError: floats that are no colours.
        """
        if self.group != "image":
            return values.reshape(-1, *self.shape).astype(self.dtype, copy=False)
        values = np.moveaxis(values, 1, -1) if self.first else values
        if len(self.shape) == 3:
            values = values[..., :3]
            if values.dtype.kind == "f":
                values = _bytes(values)
        values = values.reshape(-1, *self.shape).astype(self.dtype, copy=False)
        return values if self.scale == 1.0 else values * np.asarray(self.scale, self.dtype)


def _grey(shape: tuple[int, ...], dtype: np.dtype[Any], first: bool = False) -> Kind:
    """Return what pictures (H, W) of a type are: brightness in bytes, all else depth."""
    if dtype == np.uint8:
        return Kind(shape, "image", "uint8", first)
    return Kind(shape, "image", "float32", first, MILLIMETRE if dtype.kind == "u" else 1.0)


def _bytes(colours: np.ndarray) -> np.ndarray:
    """Return colours from 0 to 1, or to 255, as bytes."""
    low, high = float(colours.min(initial=0.0)), float(colours.max(initial=0.0))
    if not (low >= 0 and high <= 255):
        raise ValueError(f"colours from {low} to {high}; they lie within 0..1 or 0..255")
    return np.rint(colours * (255.0 if high <= 1.0 else 1.0)).astype(np.uint8)
