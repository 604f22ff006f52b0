"""Keys and sticks mean what the tables say; conflicts and misspellings are told by name."""

from __future__ import annotations

import pytest

from aerial_il.core import presets
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.teleop import devices
from aerial_il.teleop.input.frame import DeviceFrame, bits_of
from aerial_il.teleop.input.inbox import Inbox
from aerial_il.teleop.input.mapping import DIRECTIONS, read_bindings
from tests.teleop.hands import shipped


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
