"""Frames keep every bit; keys and sticks mean what the tables say; misspellings are told by name."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerial_il.core import presets
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.teleop import devices
from aerial_il.teleop.input.frame import LABELS, NUM_AXES, DeviceFrame, bits_of, names_of
from aerial_il.teleop.input.inbox import Inbox
from aerial_il.teleop.input.mapping import DIRECTIONS, read_bindings
from tests.teleop.hands import shipped

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


def test_every_device_has_a_file_and_every_file_a_device() -> None:
    assert set(presets.names("device")) == set(devices.names())
    for name in devices.names():
        shipped(name)


@pytest.mark.parametrize(
    ("code", "motion", "value"),
    [("KeyW", "forward", 1), ("KeyS", "forward", -1), ("KeyA", "lateral", 1), ("KeyE", "up", 1), ("Space", "grip", 1)],
)
def test_keys_mean_what_the_table_says(code: str, motion: str, value: int) -> None:
    bindings = shipped("keyboard")
    frame = DeviceFrame(seq=1, held=bits_of([code], bindings.controls))
    assert bindings.intent(frame).digital[motion] == value


def test_every_direction_has_a_key() -> None:
    assert set(DIRECTIONS) <= set(shipped("keyboard").keys.values())


def test_sticks_of_the_standard_mapping_have_y_down() -> None:
    frame = DeviceFrame(axes=(-1.0, -0.5, 0.25, -1.0, 0.0, 1.0, 0.0, 0.0))
    assert shipped("gamepad").intent(frame).analogue == {
        "forward": 1.0,
        "lateral": -0.25,
        "up": 0.5,
        "yaw": 1.0,
        "grip": 1.0,
        "roll": 0.0,
        "pitch": 0.0,
    }


def test_a_tap_shorter_than_a_tick_counts_for_one_tick() -> None:
    bindings = shipped("keyboard")
    inbox = Inbox(bindings)
    inbox.receive(seq=1, held=["KeyW"], pressed=["KeyW", "KeyR"], axes={}, t_client=0.0)
    inbox.receive(seq=2, held=[], pressed=[], axes={}, t_client=1.0)
    first, second = bindings.intent(inbox.frame()), bindings.intent(inbox.frame())
    assert first.digital["forward"] == 1.0
    assert first.pressed == {"record"}
    assert second.digital["forward"] == 0.0
    assert not second.pressed


def test_a_held_key_is_pressed_once() -> None:
    bindings = shipped("keyboard")
    inbox = Inbox(bindings)
    inbox.receive(seq=1, held=["KeyR"], pressed=["KeyR"], axes={}, t_client=0.0)
    assert [bindings.intent(inbox.frame()).pressed for _ in range(3)] == [{"record"}, set(), set()]


def test_a_key_bound_twice_names_both() -> None:
    with pytest.raises(InvalidValueError, match=r"KeyW is bound twice, to 'forward\+' and to 'up\+'"):
        read_bindings({"forward+": "KeyW", "up+": ["KeyE", "KeyW"]}, devices.controls_of("keyboard"), device="keyboard")


@pytest.mark.parametrize(
    ("raw", "near"),
    [({"foward+": "KeyW"}, "forward+"), ({"forward+": "KeyWW"}, "KeyW"), ({"forward": "-rigth_y"}, None)],
)
def test_what_is_misspelt_is_answered_with_the_nearest(raw: dict, near: str | None) -> None:
    with pytest.raises(UnknownNameError) as caught:
        read_bindings(raw, devices.controls_of("keyboard"), device="keyboard")
    assert near is None or f"Did you mean {near!r}?" in str(caught.value)


def test_an_unknown_device_is_answered_with_those_there_are() -> None:
    with pytest.raises(UnknownNameError, match="keyboard"):
        devices.bindings_of({"keybord": {}})


def test_devices_used_at_once_share_the_bits_of_a_frame() -> None:
    bindings = shipped("keyboard", "gamepad", "touch")
    assert len(set(bindings.controls)) == len(bindings.controls) <= 64
    held = bits_of(["KeyW", "pad:LB"], bindings.controls)
    intent = bindings.intent(DeviceFrame(held=held))
    assert intent.digital["forward"] == 1.0
    assert intent.held == {"precision"}
    assert bindings.axes["forward"] == ("-right_y",), "a stick that two devices share counts once"
