"""A leader arm at the other end of a serial line: what its servos say in packets is what the joints take."""

import json
import math
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.teleop import devices
from aerial_il.teleop.devices import leader_arm
from aerial_il.teleop.devices.leader_arm import LIVE, LeaderArm, OpenArm, Servo, read_calibration
from aerial_il.teleop.input import serial_port
from aerial_il.teleop.input.hardware import DeviceError, DeviceLostError, Reading
from aerial_il.teleop.input.serial_port import SerialPort
from tests.patience import HANG_S
from tests.teleop.simulated import JOINTS, FakeArm

pytestmark = pytest.mark.usefixtures("patient")
PROTOCOLS = ("feetech", "dynamixel")
STEP = math.tau / 4096 / math.pi  # of an axis


def opened(arm: FakeArm, joints: tuple[str, ...] = JOINTS) -> OpenArm:
    return LeaderArm(**arm.settings, joints=joints, gripper="gripper").open()


def read_until(port: OpenArm, wanted: Callable[[Reading], bool]) -> Reading:
    end = time.monotonic() + HANG_S
    while time.monotonic() < end:
        if wanted(reading := port.read()):
            return reading
    raise AssertionError(reading)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_joints_are_taken_one_to_one(tmp_path: Path, protocol: str) -> None:
    arm = FakeArm(tmp_path, protocol)
    port = opened(arm, ("shoulder_pan", "-shoulder_lift", "elbow_flex", "wrist_flex"))
    arm.steps |= {1: 2048 + 512, 2: 2048 + 256, 5: 3072}
    reading = read_until(port, lambda reading: abs(reading.axes.get("leader_1", 0.0)) > 0.1)
    assert reading.held == (LIVE,)
    assert reading.axes["leader_1"] == pytest.approx(512 * STEP)
    assert reading.axes["leader_2"] == pytest.approx(-256 * STEP), "the other way round"
    assert reading.axes["leader_3"] == 0.0
    assert reading.axes["leader_grip"] == 1.0
    port.close()
    arm.close()


def test_calibrations_are_those_of_lerobot() -> None:
    servo = Servo(id=1, range_min=1000, range_max=3000)
    assert servo.angle(2000 + 1024) == pytest.approx(math.pi / 2)
    assert servo.opening(1500) == 0.25
    other = Servo(id=1, drive_mode=1, range_min=1000, range_max=3000)
    assert other.angle(2000 + 1024) == pytest.approx(-math.pi / 2)
    assert other.opening(1500) == 0.75
    with pytest.raises(InvalidValueError):
        Servo(id=1, range_min=5, range_max=5)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_packets_that_are_spoilt_are_left_out(tmp_path: Path, protocol: str) -> None:
    """A third with a wrong checksum, a third with a byte lost: never is shown what nobody said."""
    arm, count = FakeArm(tmp_path, protocol), [0]
    port = opened(arm)

    def spoil(packet: bytes) -> bytes:
        count[0] += 1
        if count[0] % 3 == 0:
            return packet[:-1] + bytes([packet[-1] ^ 0x55])
        return packet[:5] + packet[6:] if count[0] % 3 == 1 else packet

    read_until(port, lambda reading: bool(reading.held))
    arm.spoil = spoil
    while port.damaged < 12:
        assert port.read().axes["leader_1"] == 0.0
    port.close()
    arm.close()


def test_an_arm_stops_while_a_servo_is_silent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arm = FakeArm(tmp_path)
    port = opened(arm)
    read_until(port, lambda reading: bool(reading.held))
    arm.silent = {3}
    monkeypatch.setattr(leader_arm, "STALE_S", 0.15)
    read_until(port, lambda reading: not reading.held and not reading.axes)
    arm.silent = set()
    read_until(port, lambda reading: bool(reading.held))
    arm.silent = set(arm.steps)
    monkeypatch.setattr(leader_arm, "SILENT_S", 0.5)
    with pytest.raises(DeviceLostError, match="no servo answers"):
        read_until(port, lambda reading: False)
    port.close()
    arm.close()


def test_a_jump_is_believed_only_when_it_is_said_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(leader_arm, "ANSWER_S", HANG_S)  # each reading hears every servo once
    arm = FakeArm(tmp_path)
    port = opened(arm)
    port.read()
    for steps, believed in ((3000, 2048), (2050, 2050), (3000, 2050), (3000, 3000)):
        arm.steps[1 + JOINTS.index("elbow_flex")] = steps
        port.read()
        assert port.steps["elbow_flex"] == believed
    port.close()
    arm.close()


def test_an_arm_that_is_unplugged_is_noticed(tmp_path: Path) -> None:
    arm = FakeArm(tmp_path)
    port = opened(arm)
    arm.unplug()
    with pytest.raises(DeviceLostError, match="unplugged"):
        read_until(port, lambda reading: False)
    port.close()


def test_servos_that_are_missing_are_named(tmp_path: Path) -> None:
    arm = FakeArm(tmp_path)
    arm.silent = {2, 5}
    with pytest.raises(DeviceError, match=r"shoulder_lift \(2\), gripper \(5\).*powered"):
        opened(arm)
    arm.close()


def test_the_calibration_of_another_arm_is_refused(tmp_path: Path) -> None:
    arm = FakeArm(tmp_path)
    arm.homing = 100
    with pytest.raises(DeviceError, match=r"homing offset 100.*-7"):
        opened(arm)
    arm.close()


def test_files_that_are_no_calibration_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "arm.json"
    with pytest.raises(DeviceError, match="cannot be read"):
        read_calibration(str(file))
    for text in ("{", "[]", '{"a": {"id": 1, "wheel": 2}}', '{"a": {"id": 300}}'):
        file.write_text(text)
        with pytest.raises(InvalidValueError, match="is no calibration"):
            read_calibration(str(file))
    file.write_text(json.dumps({"a": {"id": 1}}))
    with pytest.raises(UnknownNameError, match="shoulder_pan"):
        LeaderArm(port="x", calibration=str(file), joints=("shoulder_pan",)).servos()


def test_settings_that_cannot_be_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="feetech"):
        LeaderArm(joints=("a",), protocol="feetec")
    with pytest.raises(InvalidValueError, match="1 to 8 joints"):
        LeaderArm()
    with pytest.raises(DeviceError, match="say where it is"):
        LeaderArm(joints=("a",)).open()
    with pytest.raises(InvalidValueError, match="123 baud"):
        SerialPort("/dev/null", 123)
    with pytest.raises(DeviceError, match="no serial line"):
        SerialPort("/dev/null", 57600)
    with pytest.raises(DeviceError, match="cannot be opened"):
        SerialPort(str(tmp_path / "ttyACM9"), 57600)
    with pytest.raises(UnknownNameError, match="port"):
        devices.drivers_of({"leader_arm": {"hardware": {"prot": "x"}}})


def test_who_may_not_open_the_line_is_told_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(serial_port.os, "open", refused)
    with pytest.raises(DeviceError, match=r"usermod -aG dialout.*udev"):
        SerialPort("/dev/ttyACM0", 1_000_000)
