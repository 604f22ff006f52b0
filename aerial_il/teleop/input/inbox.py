"""Messages of devices on their way to the next tick: what arrives in between is kept until it is consumed.

Those of the page come over its socket, those of other devices from a thread each. All end in one frame a tick, which is
all that the flight sees and all that is logged, so that a log replays whatever came from where. The page is the dead
man's switch of every device: while nobody is at it, none of them moves anything.
"""

import threading
import time
from collections.abc import Callable, Iterable, Mapping

from aerial_il.teleop.input.frame import AXES, DeviceFrame, bits_of
from aerial_il.teleop.input.hardware import Reading
from aerial_il.teleop.input.mapping import Bindings

STALE_S = 0.3  # what a device showed longer ago means nothing any more


class Inbox:
    """A device that other threads write to.

    Args:
        bindings: in whose order the frames' bits stand. now: a clock in s, for tests.
    """

    def __init__(self, bindings: Bindings, now: Callable[[], float] = time.monotonic) -> None:
        self._controls, self._lock, self._now = bindings.controls, threading.Lock(), now
        self._latest, self._edges, self._present = DeviceFrame(), 0, False
        self._readings: dict[str, tuple[float, Reading]] = {}

    def receive(
        self, *, seq: int, held: Iterable[str], pressed: Iterable[str], axes: Mapping[str, float], t_client: float
    ) -> None:
        """Take note of what the page holds, and of what was pressed since its last message, however briefly.

        Raises:
            InvalidValueError: values that no frame has.
        """
        frame = DeviceFrame(
            seq=seq,
            axes=tuple(axes.get(name, 0.0) for name in AXES),
            held=bits_of(held, self._controls),
            edges=bits_of(pressed, self._controls),
            t_client=t_client,
        )
        with self._lock:
            self._latest, self._edges, self._present = frame, self._edges | frame.edges, True

    def note(self, device: str, reading: Reading) -> None:
        """Take note of what a device shows that the page does not read."""
        with self._lock:
            self._readings[device] = self._now(), reading
            if self._present:
                self._edges |= bits_of(reading.pressed, self._controls)

    def rebind(self, bindings: Bindings) -> None:
        """Take frames in the order of other bindings from now on; everything is let go."""
        with self._lock:
            self._controls = bindings.controls
            self._latest, self._edges = DeviceFrame(seq=self._latest.seq), 0

    def release(self) -> None:
        """Let everything go: nobody is there any more."""
        with self._lock:
            self._latest, self._edges, self._present = DeviceFrame(seq=self._latest.seq), 0, False

    def frame(self) -> DeviceFrame:
        with self._lock:
            latest, edges, self._edges = self._latest, self._edges, 0
            since = self._now() - STALE_S
            readings = [reading for at, reading in self._readings.values() if at > since] if self._present else []
        if not readings:
            return DeviceFrame(latest.seq, latest.axes, latest.held, edges, latest.t_client)
        axes, held = dict(zip(AXES, latest.axes, strict=True)), latest.held
        for reading in readings:
            axes |= reading.axes
            held |= bits_of(reading.held, self._controls)
        return DeviceFrame(latest.seq, tuple(axes.values()), held, edges, latest.t_client)
