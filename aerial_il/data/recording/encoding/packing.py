"""Turn many steps into many messages by moving bytes, compiled, while the interpreter does something else.

A step is gathered in one row, a structured value; a message is a template with slots. Which bytes of the row belong in
which slots is worked out once.
"""

from collections.abc import Iterable

import numpy as np

from aerial_il.core.kernels import kernel

Move = tuple[int, int, int]  # first byte in the row, first byte in the record, how many


class Packer:
    """Writes records of equal size.

    Args:
        template: the bytes of one record.
        moves: what of the row goes where; neighbours are joined.
    """

    def __init__(self, template: bytes, moves: Iterable[Move]) -> None:
        self._template = np.frombuffer(template, np.uint8)
        self._moves = np.array(_joined(moves), np.int64).reshape(-1, 3)

    def pack(self, rows: np.ndarray) -> np.ndarray:
        """Return the records (k, B) uint8 of ``rows`` (k,), a contiguous structured array."""
        records = np.empty((len(rows), len(self._template)), np.uint8)
        _pack(records, self._template, bytes_of(rows), self._moves)
        return records


def bytes_of(rows: np.ndarray) -> np.ndarray:
    """Show a contiguous structured array (..., ) as its bytes (..., itemsize)."""
    return rows.view(np.uint8).reshape(*rows.shape, rows.dtype.itemsize)


def gather(
    rows: np.ndarray, places: tuple[np.ndarray, np.ndarray, np.ndarray], fields: Iterable[tuple[int, np.ndarray]]
) -> None:
    """Copy fields of some worlds into their rows, all in one call: each call may lose the interpreter to a writer.

    Args:
        rows: (slots, steps, R) uint8.
        places: the worlds (w,), and for all worlds (n,) the slot and the step.
        fields: of each the byte of the row at which it begins, and its values (n, ...) of all worlds in its dtype.
    """
    filled = [(first, _bytes_per_world(values)) for first, values in fields if values.size]
    if filled:
        firsts, values = zip(*filled, strict=True)
        _gather(rows, *places, np.array(firsts), values)


def first_not_finite(values: np.ndarray) -> tuple[int, int] | None:
    """Return row and column of the first element of ``values`` (k, m) that is NaN or infinite, or None."""
    row, column = _first_not_finite(values)
    return None if row < 0 else (row, column)


def first_difference(records: np.ndarray, template: np.ndarray, mask: np.ndarray) -> tuple[int, int] | None:
    """Return row and byte of the first place where ``records`` (k, B) differ from ``template`` (B,), or None.

    Args:
        mask: (B,) 255 for the bytes that are compared, 0 for others.
    """
    row, byte = _first_difference(records, template, mask)
    return None if row < 0 else (row, byte)


def _bytes_per_world(values: np.ndarray) -> np.ndarray:
    """Show ``values`` (n, ...) as (n, B) uint8, of the one type of array that compiled code knows."""
    return np.require(values, requirements=("C", "W")).reshape(len(values), -1).view(np.uint8)


def _joined(moves: Iterable[Move]) -> list[Move]:
    found: list[Move] = []
    for source, target, size in sorted(moves, key=lambda move: move[1]):
        if found and found[-1][0] + found[-1][2] == source and found[-1][1] + found[-1][2] == target:
            found[-1] = (*found[-1][:2], found[-1][2] + size)
        else:
            found.append((source, target, size))
    return found


# One-dimensional views in the inner loops, so that the compiler makes block copies of them: 15 times faster.


@kernel
def _pack(records, template, rows, moves):
    for i in range(len(records)):
        record, row = records[i], rows[i]
        for byte in range(len(template)):
            record[byte] = template[byte]
        for move in range(len(moves)):
            source, target = row[moves[move, 0] :], record[moves[move, 1] :]
            for byte in range(moves[move, 2]):
                target[byte] = source[byte]


@kernel
def _gather(rows, worlds, slots, steps, firsts, values):
    for world in worlds:
        row = rows[slots[world], steps[world]]
        for field in range(len(values)):
            source, target = values[field][world], row[firsts[field] :]
            for byte in range(len(source)):
                target[byte] = source[byte]


@kernel
def _first_not_finite(values):
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            if not np.isfinite(values[i, j]):
                return i, j
    return -1, -1


@kernel
def _first_difference(records, template, mask):
    for i in range(len(records)):
        record, difference = records[i], 0
        for byte in range(len(template)):
            difference |= (record[byte] ^ template[byte]) & mask[byte]
        if difference:
            for byte in range(len(template)):
                if (record[byte] ^ template[byte]) & mask[byte]:
                    return i, byte
    return -1, -1
