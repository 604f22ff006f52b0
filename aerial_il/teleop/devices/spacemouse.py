"""A SpaceMouse of 3Dconnexion: six axes and buttons, from the reports that Linux hands out at ``/dev/hidraw*``.

Reports, as their descriptors declare them and as they were recorded from a SpaceNavigator and a SpaceMouse Wireless
(github.com/AndunHH/spacemouse: SpaceNavigator.md, SpaceMouseWireless.md): the first byte is the number of the report,
numbers are 16 bits, little-endian, signed, ±350 at full deflection. 1: translation x, y, z; 2: rotation rx, ry, rz;
newer ones put all six into report 1. 3: buttons, one bit each. Others (23: the battery) mean nothing here. While it is
deflected it reports every 8 or 16 ms, at rest it is silent.

Axes are those of USB's HID Usage Tables (section 4.2): x to the right, y towards the user, z down, turns by the right
hand about them. Here x is ahead, y left, z up, so each is the negative of one of theirs.

Products: github.com/JakubAndrysek/PySpaceMouse (devices.toml) and github.com/FreeSpacenav/spacenavd.
"""

import os
import select
import struct
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from aerial_il.teleop.input.frame import MOUSE_AXES
from aerial_il.teleop.input.hardware import DeviceError, DeviceLostError, Reading

BUTTONS = 32
CONTROLS = tuple(f"mouse:{i}" for i in range(1, BUTTONS + 1))
FULL = 350.0
STALE_S = 0.3  # a deflected one that says nothing for so long has let go
POLL_S = 0.02
HIDRAW = Path("/sys/class/hidraw")
PRODUCTS = {  # (vendor, product) -> name; Logitech made the older ones
    (0x046D, 0xC625): "SpacePilot",
    (0x046D, 0xC626): "SpaceNavigator",
    (0x046D, 0xC627): "SpaceExplorer",
    (0x046D, 0xC628): "SpaceNavigator for Notebooks",
    (0x046D, 0xC629): "SpacePilot Pro",
    (0x046D, 0xC62B): "SpaceMouse Pro",
    (0x256F, 0xC62E): "SpaceMouse Wireless (cable)",
    (0x256F, 0xC62F): "SpaceMouse Wireless (receiver)",
    (0x256F, 0xC631): "SpaceMouse Pro Wireless (cable)",
    (0x256F, 0xC632): "SpaceMouse Pro Wireless (receiver)",
    (0x256F, 0xC633): "SpaceMouse Enterprise",
    (0x256F, 0xC635): "SpaceMouse Compact",
    (0x256F, 0xC638): "SpaceMouse Pro Wireless (Bluetooth)",
    (0x256F, 0xC63A): "SpaceMouse Wireless (Bluetooth)",
    (0x256F, 0xC641): "SpaceMouse Module",
    (0x256F, 0xC652): "Universal Receiver",
}
RULE = 'KERNEL=="hidraw*", ATTRS{idVendor}=="256f|046d", MODE="0660", TAG+="uaccess"'


class Decoder:
    """Puts reports together to what the device shows now."""

    def __init__(self) -> None:
        self.raw = [0] * 6  # x, y, z, rx, ry, rz, as the device counts them
        self.buttons = 0

    def feed(self, report: bytes) -> tuple[str, ...]:
        """Take note of one report; return the buttons that went down. What no SpaceMouse sends changes nothing."""
        number, rest = report[0] if report else 0, report[1:]
        if number == 1 and len(rest) >= 12:
            self.raw = list(struct.unpack_from("<6h", rest))
        elif number in (1, 2) and len(rest) >= 6:
            self.raw[3 * (number - 1) : 3 * number] = struct.unpack_from("<3h", rest)
        elif number == 3 and rest:
            before, self.buttons = self.buttons, int.from_bytes(rest[: BUTTONS // 8], "little")
            return _names(self.buttons & ~before)
        return ()

    def axes(self) -> dict[str, float]:
        """Return the deflection in [-1, 1]: ahead, left, up, and the turns about them."""
        x, y, z, rx, ry, rz = (max(-1.0, min(1.0, value / FULL)) for value in self.raw)
        return dict(zip(MOUSE_AXES, (-y, -x, -z, -ry, -rx, -rz), strict=True))

    def held(self) -> tuple[str, ...]:
        """Return the buttons that are down."""
        return _names(self.buttons)


class OpenMouse:
    """A SpaceMouse whose reports are read.

    Args:
        path: of its device file. now: a clock in s, for tests.
    """

    def __init__(self, path: Path, now: Callable[[], float] = time.monotonic) -> None:
        self._file, self._decoder, self._now = os.open(path, os.O_RDONLY | os.O_NONBLOCK), Decoder(), now
        self._moved = now()

    def read(self) -> Reading:
        pressed: list[str] = []
        wait = POLL_S
        while select.select([self._file], [], [], wait)[0]:
            pressed += self._decoder.feed(self._report())
            wait = 0.0
        if self._now() - self._moved > STALE_S:
            self._decoder.raw = [0] * 6
        return Reading(self._decoder.axes(), self._decoder.held(), tuple(pressed))

    def close(self) -> None:
        os.close(self._file)

    def _report(self) -> bytes:
        try:
            report = os.read(self._file, 64)
        except OSError as error:
            raise DeviceLostError(f"it was unplugged: {error.strerror}") from error
        if not report:
            raise DeviceLostError("it was unplugged")
        if report[0] in (1, 2):
            self._moved = self._now()
        return report


@dataclass(frozen=True)
class SpaceMouse:
    """How a SpaceMouse is opened.

    Attributes:
        path: of its device file, e.g. ``/dev/hidraw3``; None for the first one that is plugged in.
    """

    path: str | None = None

    def open(self) -> OpenMouse:
        """Find and open it."""
        path = Path(self.path) if self.path is not None else plugged_in()
        try:
            return OpenMouse(path)
        except PermissionError as error:
            raise DeviceError(
                f"spacemouse: {path} may not be read. Write this line to /etc/udev/rules.d/70-spacemouse.rules, then "
                f"`sudo udevadm control --reload && sudo udevadm trigger`, and plug it in again: {RULE}"
            ) from error
        except OSError as error:
            raise DeviceError(f"spacemouse: {path} cannot be opened: {error.strerror}. Is it plugged in?") from error


def plugged_in(folder: Path = HIDRAW) -> Path:
    """Return the device file of the first SpaceMouse that is plugged in.

    Raises:
        DeviceError: there is none.
    """
    for entry in sorted(folder.glob("hidraw*")) if folder.is_dir() else []:
        if _identity(entry) in PRODUCTS:
            return Path("/dev") / entry.name
    where = "" if sys.platform == "linux" else " It is read on Linux only."
    raise DeviceError(
        "spacemouse: none is plugged in (`lsusb` should show 256f:... or 046d:c62...). Plug it in, name its file with "
        f"hardware=[spacemouse.path:/dev/hidrawN], or leave spacemouse out of devices=[...].{where}"
    )


def _identity(entry: Path) -> tuple[int, int] | None:
    """Return the vendor and product that the kernel names: ``HID_ID=0003:0000256F:0000C635``."""
    try:
        lines = (entry / "device" / "uevent").read_text(encoding="ascii", errors="replace").splitlines()
        line = next(each for each in lines if each.startswith("HID_ID="))
        _, vendor, product = line.removeprefix("HID_ID=").split(":")
        return int(vendor, 16), int(product, 16)
    except (OSError, StopIteration, ValueError):
        return None


def _names(bits: int) -> tuple[str, ...]:
    return tuple(name for i, name in enumerate(CONTROLS) if bits >> i & 1)


DRIVER = SpaceMouse
