"""Devices that no browser reads: a thread of the server asks each, notices when it is gone, and looks for it again."""

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from aerial_il.core.errors import AerialError

AGAIN_S = 0.5  # between two attempts to find a device that is gone


class DeviceError(AerialError, OSError):
    """A device that is not there, or that nobody may read."""


class DeviceLostError(DeviceError):
    """A device that was there, and is gone."""


@dataclass(frozen=True)
class Reading:
    """What a device shows.

    Attributes:
        axes: name -> position in [-1, 1], of ``AXES``. held: names of its controls that are down.
        pressed: those that went down since the last reading, however briefly.
    """

    axes: Mapping[str, float] = field(default_factory=dict)
    held: tuple[str, ...] = ()
    pressed: tuple[str, ...] = ()


class Port(Protocol):
    """A device that is open."""

    def read(self) -> Reading:
        """Return what it shows, after at most 50 ms.

        Raises:
            DeviceLostError: it is gone.
        """
        ...

    def close(self) -> None:
        """Let it go."""
        ...


class Driver(Protocol):
    """Knows how to open a device; its constructor takes the values of ``hardware`` in the device's YAML."""

    def open(self) -> Port:
        """Find and open it.

        Raises:
            DeviceError: it is not there, or may not be read; says what to do.
        """
        ...


class Attached:
    """Asks one device on a thread of its own, for as long as a session lasts.

    Args:
        name: of the device. driver: how it is opened. receive: gets each reading. lost: called once each time that it
            is gone, with what to do; back: called once when it is there again.
    """

    def __init__(
        self,
        name: str,
        driver: Driver,
        receive: Callable[[str, Reading], None],
        *,
        lost: Callable[[str], None] = lambda problem: None,
        back: Callable[[str], None] = lambda name: None,
    ) -> None:
        self.name, self._driver, self._receive, self._lost, self._back = name, driver, receive, lost, back
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._port: Port | None = None

    def start(self) -> None:
        """Open the device, and begin to ask it.

        Raises:
            DeviceError: it is not there at the beginning.
        """
        self._port = self._driver.open()
        self._thread.start()

    def close(self) -> None:
        """End it."""
        self._ended.set()
        if self._thread.ident is not None:
            self._thread.join()
        if self._port is not None:
            self._port.close()

    def _run(self) -> None:
        while not self._ended.is_set():
            if self._port is None:
                self._look()
            else:
                self._ask(self._port)

    def _ask(self, port: Port) -> None:
        try:
            self._receive(self.name, port.read())
        except OSError as error:
            port.close()
            self._port = None
            self._receive(self.name, Reading())
            self._lost(f"{self.name} is gone ({error}). It flies on once it is back; until then take another device.")

    def _look(self) -> None:
        try:
            self._port = self._driver.open()
        except OSError:
            self._ended.wait(AGAIN_S)
        else:
            self._back(self.name)


def paced(started: float, period_s: float) -> None:
    """Wait until ``period_s`` has passed since ``started``, on ``time.perf_counter``."""
    time.sleep(max(0.0, started + period_s - time.perf_counter()))
