"""The contract of all devices, found by being there: what each needs to be one, and what happens when it is gone."""

import time
from pathlib import Path
from threading import Event

import pytest

from aerial_il.core import presets
from aerial_il.core.contracts import Device
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.teleop import devices
from aerial_il.teleop.devices.replay import Replay
from aerial_il.teleop.devices.scripted import Scripted
from aerial_il.teleop.input.frame import AXES, DeviceFrame, names_of
from aerial_il.teleop.input.hardware import Attached, Reading
from aerial_il.teleop.input.inbox import STALE_S, Inbox
from aerial_il.teleop.input.mapping import COMMANDS
from tests.patience import HANG_S, wait_until
from tests.teleop.hands import shipped
from tests.teleop.simulated import SIMULATED, simulated

NAMES = devices.names()
DRIVEN = sorted(devices.drivers_of({name: presets.read("device", name) for name in NAMES}))


@pytest.mark.parametrize("name", NAMES)
def test_every_device_maps_controls_of_its_own_to_commands(name: str) -> None:
    controls, raw = devices.controls_of(name), presets.read("device", name)
    assert len(set(controls)) == len(controls)
    assert set(raw) - {devices.HARDWARE} <= set(COMMANDS)
    assert (devices.HARDWARE in raw) == (name in DRIVEN), "settings where there is something to set"
    bindings = shipped(name)
    assert set(bindings.keys) <= set(controls)
    others = {control for other in NAMES if other != name for control in devices.controls_of(other)}
    assert not set(controls) & others or name in ("scripted",)


def test_what_stands_in_for_a_device_answers_with_frames() -> None:
    stand_ins = [Inbox(shipped("keyboard")), Scripted(lambda _: (), shipped("keyboard")), Replay([])]
    for device in stand_ins:
        assert isinstance(device, Device)
        assert isinstance(device.frame(), DeviceFrame)
    assert not isinstance(object(), Device)


@pytest.mark.parametrize("name", DRIVEN)
def test_every_driver_is_made_of_its_file_and_can_be_simulated(name: str) -> None:
    assert name in SIMULATED, "whoever writes a driver writes what it can be tried with"
    drivers = devices.drivers_of({name: presets.read("device", name)})
    with pytest.raises(OSError, match=name):
        drivers[name].open()


def driver_of(name: str, settings: dict) -> devices.Driver:
    return devices.drivers_of({name: presets.read("device", name)}, {name: settings})[name]


@pytest.mark.parametrize("name", DRIVEN)
def test_every_driven_device_is_read_lost_and_found_again(name: str, tmp_path: Path) -> None:
    seen: list[Reading] = []
    lost, back = list[str](), Event()
    with simulated(name, tmp_path) as device:
        attached = Attached(
            name,
            driver_of(name, device.settings),
            lambda _, reading: seen.append(reading),
            lost=lost.append,
            back=lambda _: back.set(),
        )
        attached.start()
        try:
            device.move()
            wait_until(lambda: any(seen[-1].axes.values()) if seen else False)
            assert set(seen[-1].axes) <= set(AXES)
            assert set(seen[-1].held) <= set(devices.controls_of(name))
            device.unplug()
            wait_until(lambda: bool(lost))
            assert seen[-1] == Reading(), "what is gone holds nothing"
            assert name in lost[0]
            time.sleep(0.6)
            assert len(lost) == 1, "it is said once"
            device.plug_in()
            assert back.wait(HANG_S)
            device.move()
            wait_until(lambda: any(seen[-1].axes.values()))
        finally:
            attached.close()


def test_a_device_that_is_not_there_at_the_start_is_told_at_once(tmp_path: Path) -> None:
    attached = Attached("spacemouse", driver_of("spacemouse", {"path": str(tmp_path / "hidraw0")}), lambda *_: None)
    with pytest.raises(OSError, match="Is it plugged in"):
        attached.start()
    attached.close()


def test_settings_of_devices_that_are_not_used_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="spacemouse"):
        devices.drivers_of({"spacemouse": {}}, {"leader_arm": {"port": "x"}})
    with pytest.raises(UnknownNameError, match="path"):
        devices.drivers_of({"spacemouse": {}}, {"spacemouse": {"pathh": "x"}})


def test_two_devices_that_give_one_place_are_refused() -> None:
    raw = presets.read("device", "leader_arm")
    with pytest.raises(InvalidValueError, match="Two devices give 'joint_1'"):
        devices.bindings_of({"leader_arm": raw, "phone": {"joint_1": "phone_x"}})


def an_inbox(now: list[float]) -> Inbox:
    return Inbox(shipped("keyboard", "spacemouse", "leader_arm"), lambda: now[0])


def a_message(inbox: Inbox, seq: int, *held: str) -> None:
    inbox.receive(seq=seq, held=held, pressed=(), axes={}, t_client=0.0)


def test_page_and_devices_end_in_one_frame() -> None:
    inbox = an_inbox([0.0])
    a_message(inbox, 4, "KeyW")
    inbox.note("spacemouse", Reading({"mouse_z": 0.5}, ("mouse:2",), ("mouse:2",)))
    inbox.note("leader_arm", Reading({"leader_1": 0.25}, ("arm:live",)))
    frame, controls = inbox.frame(), shipped("keyboard", "spacemouse", "leader_arm").controls
    assert frame.seq == 4
    assert names_of(frame.held, controls) == {"KeyW", "mouse:2", "arm:live"}
    assert names_of(frame.edges, controls) == {"mouse:2"}
    assert dict(zip(AXES, frame.axes, strict=True))["mouse_z"] == 0.5
    assert not inbox.frame().edges, "a press counts once"
    assert DeviceFrame.from_row(frame.to_row()) == frame, "and that is all that is logged"


def test_what_a_device_showed_long_ago_means_nothing() -> None:
    now = [0.0]
    inbox = an_inbox(now)
    a_message(inbox, 1)
    inbox.note("spacemouse", Reading({"mouse_x": 1.0}))
    now[0] += STALE_S + 0.01
    a_message(inbox, 2)
    assert not any(inbox.frame().axes)


def test_while_nobody_is_at_the_page_no_device_moves_anything() -> None:
    inbox = an_inbox([0.0])
    pushed = Reading({"mouse_x": 1.0}, ("mouse:2",), ("mouse:2",))
    inbox.note("spacemouse", pushed)
    assert inbox.frame() == DeviceFrame()
    a_message(inbox, 1)
    assert any(inbox.frame().axes)
    inbox.release()
    inbox.note("spacemouse", pushed)
    assert inbox.frame() == DeviceFrame(seq=1)
