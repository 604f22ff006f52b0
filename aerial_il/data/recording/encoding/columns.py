"""Many steps as one message, column by column: what does not change is said once.

Of the numbers of a step about half stand still in a flight. The message is CDR, see ``STEPS_DEFINITION``; compiled code
makes it whole.
"""

import struct
from dataclasses import dataclass

import numpy as np

from aerial_il.core.kernels import kernel

MOST_STEPS = 64  # of a message; keeps a forged one from swelling
EXPONENT = np.uint64(0x7FF0000000000000)  # all ones: infinite or not a number

# The record's opcode, length, channel, sequence, log and publish time; encapsulation; stamp, frame "", first, count.
_HEAD = struct.Struct("<BQHIQQ4siIIB3xII")
_ENCAPSULATION = b"\x00\x01\x00\x00"
_MESSAGE = 5


@dataclass(frozen=True)
class Steps:
    """Some consecutive steps.

    Attributes:
        first: number of the first one. time_ns: its time. numbers: (k, M) float64.
    """

    first: int
    time_ns: int
    numbers: np.ndarray


def to_record(channel: int, steps: Steps, finite_width: int) -> bytes | None:
    """Return steps as one MCAP message record; None if one of their first ``finite_width`` numbers is not finite."""
    words = steps.numbers.view(np.uint64)
    changes = np.zeros(words.shape[1], np.uint64)
    _find_changes(words, changes)
    changing = np.flatnonzero(changes).astype(np.uint32)
    values = np.empty((len(changing), len(words)), np.uint64)
    if not _to_columns(words, changing, values, finite_width):
        return None
    padding = bytes(4 * (len(changing) % 2)) if len(changing) else b""
    parts = (
        struct.pack("<I4x", words.shape[1]),
        words[0].tobytes(),
        struct.pack("<I", len(changing)),
        changing.tobytes(),
        struct.pack("<I", values.size),
        padding,
        values.tobytes(),
    )
    body = b"".join(parts)
    seconds, nanoseconds = divmod(steps.time_ns, 10**9)
    head = _HEAD.pack(
        _MESSAGE,
        _HEAD.size - 9 + len(body),
        channel,
        steps.first,
        steps.time_ns,
        steps.time_ns,
        _ENCAPSULATION,
        seconds,
        nanoseconds,
        1,
        0,
        steps.first,
        len(words),
    )
    return head + body


def from_record(record: np.ndarray, width: int) -> Steps:
    """Read a message record (B,) uint8 of steps of ``width`` numbers.

    Raises:
        ValueError: it is not what :func:`to_record` makes.
    """
    raw = record.tobytes()
    if len(raw) < _HEAD.size + 8 + 8 * width + 8:
        raise ValueError("is too short")
    head = _HEAD.unpack_from(raw)
    first, count = head[-2:]
    if not 1 <= count <= MOST_STEPS:
        raise ValueError(f"holds {count} steps, not 1 to {MOST_STEPS}")
    position = _HEAD.size + 8
    start = np.frombuffer(raw, np.uint64, width, position)
    (changing_size,) = struct.unpack_from("<I", raw, position := position + 8 * width)
    values_at = position + 4 + 4 * changing_size + 4 + (4 * (changing_size % 2))
    if changing_size > width or len(raw) != values_at + 8 * changing_size * count:
        raise ValueError("has another size than its contents")
    changing = np.frombuffer(raw, np.uint32, changing_size, position + 4)
    words = np.repeat(start[None], count, 0)
    if changing_size:
        if changing[-1] >= width or (np.diff(changing.astype(np.int64)) <= 0).any():
            raise ValueError("names columns that it does not have, or twice")
        words[:, changing] = np.frombuffer(raw, np.uint64, offset=values_at).reshape(changing_size, count).T
    steps = Steps(first, head[4], words.view(np.float64))
    if to_record(head[2], steps, 0) != raw:
        raise ValueError("differs from what it says")
    return steps


# One-dimensional views in the inner loops, so that the compiler takes several numbers at a time.


@kernel
def _find_changes(words, changes):
    """Set bits in ``changes`` (M,) for each column of ``words`` (k, M) that is not the same all along."""
    start = words[0]
    for i in range(1, len(words)):
        row = words[i]
        for j in range(len(changes)):
            changes[j] |= row[j] ^ start[j]


@kernel
def _to_columns(words, changing, values, finite_width):
    """Copy the columns ``changing`` (C,) of ``words`` (k, M) to ``values`` (C, k); return whether all is finite."""
    finite, start = True, words[0]
    for j in range(finite_width):
        finite &= (start[j] & EXPONENT) != EXPONENT
    for i in range(len(words)):
        row = words[i]
        for c in range(len(changing)):
            word = row[changing[c]]
            values[c, i] = word
            finite &= ((word & EXPONENT) != EXPONENT) | (changing[c] >= finite_width)
    return finite
