"""Devices that are not there, down to their bytes: reports in a pipe, servos at the other end of a serial line."""

import fcntl
import json
import os
import pty
import select
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from aerial_il.teleop.input.servo_bus import LANGUAGES, SYNC_READ, Answer, DamagedError, Register, crc16

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex")


class FakeMouse:
    """Reports in a pipe that keeps them apart, as ``/dev/hidraw*`` does."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "hidraw0"
        self.plug_in()

    @property
    def settings(self) -> dict[str, Any]:
        return {"path": str(self._path)}

    def plug_in(self) -> None:
        os.mkfifo(self._path)
        self._file = os.open(self._path, os.O_RDWR | os.O_NONBLOCK)
        fcntl.fcntl(self._file, fcntl.F_SETFL, os.O_NONBLOCK | os.O_DIRECT)  # each write is a report of its own

    def unplug(self) -> None:
        self._path.unlink()
        os.close(self._file)

    def send(self, *reports: bytes) -> None:
        for report in reports:
            os.write(self._file, report)

    def move(self) -> None:
        """Push it ahead by half, and hold a button."""
        self.send(translation(0, -175, 0), buttons(1))

    def close(self) -> None:
        if self._path.exists():
            self.unplug()


def translation(x: int, y: int, z: int) -> bytes:
    return b"\x01" + struct.pack("<3h", x, y, z)


def rotation(rx: int, ry: int, rz: int) -> bytes:
    return b"\x02" + struct.pack("<3h", rx, ry, rz)


def combined(*six: int) -> bytes:
    return b"\x01" + struct.pack("<6h", *six)


def buttons(bits: int, size: int = 2) -> bytes:
    return b"\x03" + bits.to_bytes(size, "little")


class FakeArm:
    """Servos that answer what they are asked, on a pseudo-terminal; ``spoil`` does to their packets what lines do."""

    def __init__(self, folder: Path, protocol: str = "feetech", homing: int = -7) -> None:
        self.protocol, self._language = protocol, LANGUAGES[protocol]
        self.steps = {i + 1: 2048 for i in range(len(JOINTS) + 1)}
        self.homing, self.silent = homing, set[int]()
        self.spoil: Callable[[bytes], bytes] = lambda packet: packet
        self._path = folder / "ttyACM0"
        names = (*JOINTS, "gripper")
        values = [{"id": i + 1, "drive_mode": 0, "homing_offset": homing, "range_min": 1024, "range_max": 3072}
                  for i in range(len(names))]  # fmt: skip
        self._calibration = folder / "leader.json"
        self._calibration.write_text(json.dumps(dict(zip(names, values, strict=True))))
        self.plug_in()

    @property
    def settings(self) -> dict[str, Any]:
        return {"port": str(self._path), "calibration": str(self._calibration), "protocol": self.protocol}

    def plug_in(self) -> None:
        self._master, self._slave = pty.openpty()
        self._path.symlink_to(os.ttyname(self._slave))
        self._here = True
        self._thread = threading.Thread(target=self._answer, args=(self._master,), daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        self._here = False
        self._thread.join()  # before its file's number is another one's
        self._path.unlink()
        os.close(self._slave)
        os.close(self._master)

    def move(self) -> None:
        self.steps[2] = 2048 + 300

    def close(self) -> None:
        if self._here:
            self.unplug()

    def _answer(self, master: int) -> None:
        with suppress(OSError):
            waiting = b""
            while self._here:
                if select.select([master], [], [], 0.02)[0]:
                    waiting += os.read(master, 256)
                while len(waiting) >= 7 and len(waiting) >= (size := self._size(waiting)):
                    packet, waiting = waiting[:size], waiting[size:]
                    self._say(master, *self._asked(packet))

    def _size(self, packet: bytes) -> int:
        return 4 + packet[3] if self.protocol == "feetech" else 7 + int.from_bytes(packet[5:7], "little")

    def _say(self, master: int, register: Register, servos: bytes) -> None:
        for servo in servos:
            if servo not in self.silent:
                value = self.homing if register == self._language.homing else self.steps[servo]
                os.write(master, self.spoil(self._language.answer(Answer(servo, 0, register.data(value)))))

    def _asked(self, packet: bytes) -> tuple[Register, bytes]:
        """Read a sync read as a servo does: by the bytes of the manuals, not by the code that wrote them."""
        if self.protocol == "feetech":
            assert packet[:3] == b"\xff\xff\xfe"
            assert packet[4] == SYNC_READ
            assert ~sum(packet[2:-1]) & 0xFF == packet[-1]
            address, servos = packet[5], packet[7:-1]
        else:
            assert packet[:5] == b"\xff\xff\xfd\x00\xfe"
            assert packet[7] == SYNC_READ
            assert crc16(packet[:-2]).to_bytes(2, "little") == packet[-2:]
            address, servos = int.from_bytes(packet[8:10], "little"), packet[12:-2]
        known = (self._language.position, self._language.homing)
        return next(register for register in known if register.address == address), servos


SIMULATED: dict[str, Callable[[Path], Any]] = {"spacemouse": FakeMouse, "leader_arm": FakeArm}


@contextmanager
def simulated(name: str, folder: Path) -> Iterator[Any]:
    """Plug in a device that is not there."""
    folder.mkdir(exist_ok=True, parents=True)
    device = SIMULATED[name](folder)
    try:
        yield device
    finally:
        device.close()


def answers(protocol: str, stream: bytes) -> list[Answer]:
    """Return all that a stream of bytes says."""
    waiting, result = bytearray(stream), []
    while True:
        try:
            answer = LANGUAGES[protocol].take(waiting)
        except DamagedError:
            continue
        if answer is None:
            return result
        result.append(answer)
