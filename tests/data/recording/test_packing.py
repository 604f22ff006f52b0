"""Fields reach the rows of the worlds that are recorded, and of no others, in whatever memory they lie."""

from __future__ import annotations

import numpy as np

from aerial_il.data.recording.encoding.packing import bytes_of, gather

ROW = np.dtype([("position", "<f8", (2,)), ("flag", "u1"), ("rest", "u1", (7,))])


def test_fields_reach_the_rows_of_recorded_worlds_alone() -> None:
    """The cheat would be to copy what happens to be contiguous and writable: a slice and constants are neither."""
    rows, positions = np.zeros((3, 4), ROW), np.arange(9.0).reshape(3, 3)[:, 1:]
    flags, nothing = np.broadcast_to(np.uint8(7), 3), np.zeros((3, 0))
    places = np.array([0, 2]), np.array([1, 0, 2]), np.array([3, 0, 1])
    gather(bytes_of(rows), places, [(0, positions), (16, flags), (16, nothing)])
    expected = np.zeros((3, 4), ROW)
    expected["position"][1, 3], expected["position"][2, 1] = [1.0, 2.0], [7.0, 8.0]
    expected["flag"][1, 3] = expected["flag"][2, 1] = 7
    np.testing.assert_array_equal(rows, expected)
