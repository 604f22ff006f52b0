"""A SpaceMouse by its bytes: those of real ones mean what their descriptors say, nonsense means nothing."""

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerial_il.teleop.devices import spacemouse
from aerial_il.teleop.devices.spacemouse import CONTROLS, STALE_S, Decoder, OpenMouse, SpaceMouse, plugged_in
from aerial_il.teleop.input.frame import MOUSE_AXES
from aerial_il.teleop.input.hardware import DeviceError, DeviceLostError
from tests.teleop.simulated import FakeMouse, buttons, combined, rotation, translation


def test_bytes_of_a_spacenavigator_are_understood() -> None:
    """Those that were recorded from one: a turn about its second axis, and its two buttons."""
    decoder = Decoder()
    decoder.feed(bytes.fromhex("01000000000000"))
    assert set(decoder.axes().values()) == {0.0}
    decoder.feed(bytes.fromhex("020000e2ff0000"))
    assert decoder.axes()["mouse_roll"] == pytest.approx(30 / 350)
    assert sum(map(abs, decoder.axes().values())) == pytest.approx(30 / 350)
    assert decoder.feed(bytes.fromhex("030300")) == ("mouse:1", "mouse:2")
    assert decoder.feed(bytes.fromhex("030200")) == ()
    assert decoder.held() == ("mouse:2",)


def test_both_layouts_mean_the_same() -> None:
    split, whole = Decoder(), Decoder()
    split.feed(translation(10, -350, 70))
    split.feed(rotation(-35, 0, 350))
    whole.feed(combined(10, -350, 70, -35, 0, 350))
    assert split.axes() == whole.axes()


@pytest.mark.parametrize(
    ("report", "axis"),
    [
        (translation(0, -350, 0), "mouse_x"),  # away from the user is ahead
        (translation(-350, 0, 0), "mouse_y"),
        (translation(0, 0, -350), "mouse_z"),  # pulled up
        (rotation(0, -350, 0), "mouse_roll"),
        (rotation(-350, 0, 0), "mouse_pitch"),
        (rotation(0, 0, -350), "mouse_yaw"),
    ],
)
def test_each_axis_is_its_own_and_full_deflection_is_one(report: bytes, axis: str) -> None:
    decoder = Decoder()
    decoder.feed(report)
    assert decoder.axes() == {name: float(name == axis) for name in MOUSE_AXES}


@given(st.binary(max_size=64))
def test_no_bytes_lead_out_of_bounds(report: bytes) -> None:
    decoder = Decoder()
    decoder.feed(report)
    assert all(abs(value) <= 1.0 for value in decoder.axes().values())
    assert set(decoder.held()) <= set(CONTROLS)


@pytest.mark.parametrize(
    "report", [b"", b"\x01", b"\x01\xff\xff\xff", b"\x02\x01\x02\x03\x04\x05", b"\x03", b"\x17d\x01"]
)
def test_reports_cut_short_or_of_the_battery_change_nothing(report: bytes) -> None:
    decoder = Decoder()
    decoder.feed(combined(1, 2, 3, 4, 5, 6))
    decoder.feed(buttons(5))
    before = decoder.axes(), decoder.held()
    decoder.feed(report)
    assert (decoder.axes(), decoder.held()) == before


def test_a_tap_between_two_readings_is_not_lost(tmp_path: Path) -> None:
    mouse, now = FakeMouse(tmp_path), [0.0]
    opened = OpenMouse(Path(mouse.settings["path"]), lambda: now[0])
    mouse.send(buttons(1), buttons(0), buttons(2), translation(0, -350, 0))
    result = opened.read()
    assert result.pressed == ("mouse:1", "mouse:2")
    assert result.held == ("mouse:2",)
    assert result.axes["mouse_x"] == 1.0
    now[0] += STALE_S + 0.01
    result = opened.read()
    assert result.axes["mouse_x"] == 0.0, "deflected and silent: it has let go"
    assert result.held == ("mouse:2",)
    mouse.unplug()
    with pytest.raises(DeviceLostError, match="unplugged"):
        opened.read()
    opened.close()


def test_the_first_one_that_is_plugged_in_is_found(tmp_path: Path) -> None:
    for number, identity in enumerate(("0003:0000046D:0000C52B", "garbage", "0003:0000256F:0000C635")):
        folder = tmp_path / f"hidraw{number}" / "device"
        folder.mkdir(parents=True)
        (folder / "uevent").write_text(f"DRIVER=hid-generic\nHID_ID={identity}\n")
    assert plugged_in(tmp_path) == Path("/dev/hidraw2"), "a mouse of Logitech's is none"
    with pytest.raises(DeviceError, match="lsusb"):
        plugged_in(tmp_path / "hidraw0")


def test_who_may_not_read_it_is_told_the_rule(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(spacemouse.os, "open", refused)
    with pytest.raises(DeviceError, match=r"udev/rules.d.*256f\|046d"):
        SpaceMouse("/dev/hidraw0").open()


def test_a_file_that_is_not_there_is_told() -> None:
    with pytest.raises(DeviceError, match=r"hidraw99.*plugged in"):
        SpaceMouse("/dev/hidraw99").open()
    assert not os.path.exists("/dev/hidraw99")
