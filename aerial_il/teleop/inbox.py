"""Messages of devices on their way to the next tick: what arrives in between is kept until it is consumed."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping

from aerial_il.teleop.frame import AXES, DeviceFrame, bits_of
from aerial_il.teleop.mapping import Bindings


class Inbox:
    """A device that other threads write to.

    Args:
        bindings: in whose order the frames' bits stand.
    """

    def __init__(self, bindings: Bindings) -> None:
        self._controls, self._lock = bindings.controls, threading.Lock()
        self._latest, self._edges = DeviceFrame(), 0

    def receive(
        self, *, seq: int, held: Iterable[str], pressed: Iterable[str], axes: Mapping[str, float], t_client: float
    ) -> None:
        """Take note of what is held, and of what was pressed since the last message, however briefly.

        Raises:
            InvalidValueError: values that no frame has.
        """
        found = DeviceFrame(
            seq=seq,
            axes=tuple(axes.get(name, 0.0) for name in AXES),
            held=bits_of(held, self._controls),
            edges=bits_of(pressed, self._controls),
            t_client=t_client,
        )
        with self._lock:
            self._latest, self._edges = found, self._edges | found.edges

    def release(self) -> None:
        """Let everything go: nobody is there any more."""
        with self._lock:
            self._latest, self._edges = DeviceFrame(seq=self._latest.seq), 0

    def frame(self) -> DeviceFrame:
        with self._lock:
            latest, edges, self._edges = self._latest, self._edges, 0
        return DeviceFrame(latest.seq, latest.axes, latest.held, edges, latest.t_client)
