"""Where dirt is on a pane: cells of a grid, kept as the bits of one number."""

from __future__ import annotations

import math

import numpy as np

from aerial_il.core.kernels import kernel

ROWS, COLUMNS, PITCH_M = 4, 11, 0.04  # of the grid; cells count from below, row by row
CELLS = ROWS * COLUMNS
PATCHES = 14  # of dirt in an episode


@kernel
def cell_middle(cell):
    """Middle of a cell of the grid, up the pane and across it, m."""
    return (cell // COLUMNS - 0.5 * (ROWS - 1)) * PITCH_M, (cell % COLUMNS - 0.5 * (COLUMNS - 1)) * PITCH_M


@kernel
def count(bits):
    """Number of bits that are set."""
    number = 0
    while bits > 0:
        number += bits & 1
        bits >>= 1
    return number


@kernel
def without_cells_near(left, tip, radius):
    """Bits of the cells with dirt that are left after the fingertips have passed ``tip``.

    Args:
        left: bits before. tip: on the pane, m. radius: within which a cell is wiped, m.
    """
    for cell in range(CELLS):
        x, y = cell_middle(cell)
        if left >> cell & 1 and math.hypot(x - tip[0], y - tip[1]) <= radius:
            left -= 1 << cell
    return left


def connected_shape(rng: np.random.Generator) -> list[int]:
    """Cells of a random connected shape of ``PATCHES``, in ascending order."""
    shape = [int(rng.integers(CELLS))]
    while len(shape) < PATCHES:
        row, column_ = divmod(shape[rng.integers(len(shape))], COLUMNS)
        down, right = ((0, 1), (0, -1), (1, 0), (-1, 0))[rng.integers(4)]
        row, column_ = row + down, column_ + right
        cell = row * COLUMNS + column_
        if 0 <= row < ROWS and 0 <= column_ < COLUMNS and cell not in shape:
            shape.append(cell)
    return sorted(shape)
