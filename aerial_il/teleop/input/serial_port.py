"""A serial line without a library of its own: eight bits, no parity, no handshake, at a given rate (POSIX)."""

import os
import select
import termios
import tty

from aerial_il.core.errors import InvalidValueError
from aerial_il.teleop.input.hardware import DeviceError, DeviceLostError


class SerialPort:
    """An open serial line.

    Args:
        path: of its device file. baud: bits per second.

    Raises:
        DeviceError: it is not there, or may not be opened. InvalidValueError: a rate that this system has not.
    """

    def __init__(self, path: str, baud: int) -> None:
        rate = getattr(termios, f"B{baud}", None)
        if rate is None:
            raise InvalidValueError(f"A serial line here has no rate of {baud} baud; servos take 57600 or 1000000.")
        try:
            self._file = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except PermissionError as error:
            raise DeviceError(
                f"{path} may not be opened. Join the group that owns it, `sudo usermod -aG dialout $USER`, and log in "
                'again; or write SUBSYSTEM=="tty", ATTRS{idVendor}=="1a86", MODE="0660", TAG+="uaccess" to '
                "/etc/udev/rules.d/70-servos.rules."
            ) from error
        except OSError as error:
            raise DeviceError(f"{path} cannot be opened: {error.strerror}. `ls /dev/ttyACM* /dev/ttyUSB*`?") from error
        try:
            self._set_up(rate)
        except (OSError, termios.error) as error:
            os.close(self._file)
            raise DeviceError(f"{path} is no serial line.") from error

    def write(self, data: bytes) -> None:
        """Send ``data``.

        Raises:
            DeviceLostError: the line is gone.
        """
        try:
            os.write(self._file, data)
        except OSError as error:
            raise DeviceLostError(f"it was unplugged: {error.strerror}") from error

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived, at the latest after ``timeout_s``; nothing if nothing has.

        Raises:
            DeviceLostError: the line is gone.
        """
        if not select.select([self._file], [], [], max(0.0, timeout_s))[0]:
            return b""
        try:
            data = os.read(self._file, 4096)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise DeviceLostError(f"it was unplugged: {error.strerror}") from error
        if not data:
            raise DeviceLostError("it was unplugged")
        return data

    def close(self) -> None:
        """Let it go."""
        os.close(self._file)

    def _set_up(self, rate: int) -> None:
        tty.setraw(self._file)
        settings = termios.tcgetattr(self._file)
        settings[2] |= termios.CLOCAL | termios.CREAD
        settings[4] = settings[5] = rate
        termios.tcsetattr(self._file, termios.TCSANOW, settings)
        termios.tcflush(self._file, termios.TCIOFLUSH)
