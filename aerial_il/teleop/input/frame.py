"""The state of all input devices at one tick: the only thing outside the simulation that a flight depends on."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from aerial_il.core.errors import InvalidValueError

STICK_AXES = ("left_x", "left_y", "right_x", "right_y", "left_trigger", "right_trigger", "spare_0", "spare_1")
MOUSE_AXES = ("mouse_x", "mouse_y", "mouse_z", "mouse_roll", "mouse_pitch", "mouse_yaw")
PHONE_AXES = ("phone_x", "phone_y", "phone_z", "phone_roll", "phone_pitch", "phone_yaw")
LEADER_AXES = (*(f"leader_{i}" for i in range(1, 9)), "leader_grip")
AXES = (*STICK_AXES, *MOUSE_AXES, *PHONE_AXES, *LEADER_AXES)
NUM_AXES, NUM_CONTROLS = len(AXES), 64
LABELS = ("seq", *AXES, "held_low", "held_high", "edges_low", "edges_high", "t_client_ms")
_HALF = 1 << 32


@dataclass(frozen=True)
class DeviceFrame:
    """One reading of a device, taken at a tick of 20 ms.

    Attributes:
        seq: number of the message that was read last; one that stands still means that nothing new arrived.
        axes: positions in [-1, 1], float32, named by ``AXES``: sticks and triggers, a SpaceMouse's deflection, how far
            a phone was moved since its clutch was closed (m, and rotation vector / π), a leader arm's joints (rad / π)
            and its gripper. Those left out are zero.
        held: bit i is set while control i of the mapping's list is held.
        edges: bit i is set if it was pressed since the last tick, however briefly.
        t_client: ms, on the clock of whoever sent it; recorded, never flown by.
    """

    seq: int = 0
    axes: tuple[float, ...] = (0.0,) * NUM_AXES
    held: int = 0
    edges: int = 0
    t_client: float = 0.0

    def __post_init__(self) -> None:
        if len(self.axes) > NUM_AXES or not all(abs(a) <= 1.0 for a in self.axes):  # NaN is not
            raise InvalidValueError(f"A device frame has up to {NUM_AXES} axes in [-1, 1], got {self.axes}.")
        rest = (0.0,) * (NUM_AXES - len(self.axes))
        object.__setattr__(self, "axes", (*(float(np.float32(a)) for a in self.axes), *rest))
        if not 0 <= self.seq < _HALF:
            raise InvalidValueError(f"A device frame is numbered from 0 to 2**32 - 1, got {self.seq}.")
        if not (0 <= self.held < 1 << NUM_CONTROLS and 0 <= self.edges < 1 << NUM_CONTROLS):
            raise InvalidValueError(f"A device frame has {NUM_CONTROLS} controls, got {self.held:#x}, {self.edges:#x}.")
        if not math.isfinite(self.t_client):
            raise InvalidValueError(f"The time of a device frame is finite, got {self.t_client}.")

    def to_row(self) -> np.ndarray:
        """Return the frame as float64 numbers named by ``LABELS``, without loss: how recordings carry it."""
        halves = [part for bits in (self.held, self.edges) for part in (bits % _HALF, bits // _HALF)]
        return np.array([self.seq, *self.axes, *halves, self.t_client])

    @staticmethod
    def from_row(row: Sequence[float] | np.ndarray, labels: Sequence[str] = LABELS) -> DeviceFrame:
        """Return the frame that :meth:`to_row` wrote; ``labels`` are those of a recording that had fewer axes."""
        numbers = [float(value) for value in row]
        if len(numbers) != len(labels) or not all(map(math.isfinite, numbers)):
            raise InvalidValueError(f"A device frame is recorded as {len(labels)} finite numbers, got {numbers}.")
        values = dict(zip(labels, numbers, strict=True))
        halves = ("held_low", "held_high", "edges_low", "edges_high")
        held_low, held_high, edges_low, edges_high = (int(values[name]) for name in halves)
        return DeviceFrame(
            seq=int(values["seq"]),
            axes=tuple(values.get(name, 0.0) for name in AXES),
            held=held_low + _HALF * held_high,
            edges=edges_low + _HALF * edges_high,
            t_client=values["t_client_ms"],
        )


def bits_of(names: Iterable[str], controls: Sequence[str]) -> int:
    """Return the bits of those ``names`` that are among ``controls``; others are not bound and mean nothing."""
    return sum(1 << controls.index(name) for name in set(names) if name in controls)


def names_of(bits: int, controls: Sequence[str]) -> frozenset[str]:
    """Return the controls whose bits are set."""
    return frozenset(name for i, name in enumerate(controls) if bits >> i & 1)
