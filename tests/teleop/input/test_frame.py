"""Frames keep every bit, and refuse what no device shows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerial_il.core.errors import InvalidValueError
from aerial_il.teleop.input.frame import LABELS, NUM_AXES, DeviceFrame, bits_of, names_of

BITS = st.integers(0, 2**64 - 1)
FRAMES = st.builds(
    DeviceFrame,
    seq=st.integers(0, 2**32 - 1),
    axes=st.tuples(*[st.floats(-1, 1, width=32)] * NUM_AXES),
    held=BITS,
    edges=BITS,
    t_client=st.floats(allow_nan=False, allow_infinity=False),
)


@given(FRAMES)
def test_a_frame_comes_back_from_its_numbers(frame: DeviceFrame) -> None:
    row = frame.to_row()
    assert DeviceFrame.from_row(row) == frame
    assert DeviceFrame.from_row(row).to_row().tobytes() == row.tobytes()


@pytest.mark.parametrize(
    "wrong",
    [
        {"seq": -1},
        {"seq": 2**32},
        {"axes": (0.0,) * (NUM_AXES + 1)},
        {"axes": (1.5, *(0.0,) * 7)},
        {"axes": (math.nan, *(0.0,) * 7)},
        {"held": -1},
        {"edges": 2**64},
        {"t_client": math.inf},
    ],
)
def test_what_no_device_shows_is_refused(wrong: dict) -> None:
    with pytest.raises(InvalidValueError):
        DeviceFrame(**wrong)


def test_foreign_numbers_are_refused() -> None:
    for row in (np.zeros(13), np.full(len(LABELS), np.nan), np.full(len(LABELS), 1e300)):
        with pytest.raises(InvalidValueError):
            DeviceFrame.from_row(row)


def test_controls_that_are_not_bound_mean_nothing() -> None:
    assert names_of(bits_of(["KeyW", "F13"], ["KeyS", "KeyW"]), ["KeyS", "KeyW"]) == {"KeyW"}


def test_a_recording_with_fewer_axes_is_read() -> None:
    labels = ("seq", "left_x", "left_y", "held_low", "held_high", "edges_low", "edges_high", "t_client_ms")
    frame = DeviceFrame.from_row([7, 0.5, -0.25, 3, 1, 2, 0, 12.5], labels)
    assert frame == DeviceFrame(seq=7, axes=(0.5, -0.25), held=3 + (1 << 32), edges=2, t_client=12.5)
