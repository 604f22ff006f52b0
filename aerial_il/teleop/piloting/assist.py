"""What keeps a beginner's flight whole: a soft fence, a cap on tilt, and a dead man's switch, all counted in ticks."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aerial_il.control.actions import WORKSPACE_HIGH, WORKSPACE_LOW
from aerial_il.teleop.piloting.command import Command, Vec3

FENCE_M = 0.4  # on the last stretch towards a wall of the workspace, speed falls to zero
FLOOR_M = 0.03  # the tool stays that far above the ground
FLOOR_STRETCH_M = 0.1
EASY_TILT, MOST_TILT = 0.35, 0.6  # rad: between them, commands fade out
STALE_TICKS = 14  # without a new message: 300 ms, with the tick that it came too late for

FENCE_LOW = (float(WORKSPACE_LOW[0]), float(WORKSPACE_LOW[1]), FLOOR_M)
FENCE_HIGH = tuple(float(x) for x in WORKSPACE_HIGH)


class DeadMan:
    """Tells when nobody is there: the number of the last message has stood still for ``STALE_TICKS``.

    It depends on the frames alone, so that a log replays; at the start nobody is there.
    """

    def __init__(self) -> None:
        self._seq, self._stale = 0, STALE_TICKS

    def step(self, seq: int) -> bool:
        """Return whether the command must be zero at this tick."""
        self._stale = 0 if seq != self._seq else min(self._stale + 1, STALE_TICKS)
        self._seq = seq
        return self._stale >= STALE_TICKS


def fenced(velocity: Vec3, pos: Sequence[float]) -> Vec3:
    """Return ``velocity`` (m/s, world), slowed where it leads ``pos`` (m) towards a wall that is near."""
    stretches = (FENCE_M, FENCE_M, FLOOR_STRETCH_M)
    slowed = []
    for v, p, low, high, stretch in zip(velocity, pos, FENCE_LOW, FENCE_HIGH, stretches, strict=True):
        left = (p - low) / stretch if v < 0.0 else (high - p) / FENCE_M
        slowed.append(v * max(0.0, min(1.0, left)))
    return slowed[0], slowed[1], slowed[2]


def within_fence(pos: Sequence[float]) -> Vec3:
    """Return ``pos`` (m), or the nearest place inside the fence."""
    x, y, z = (min(max(p, low), high) for p, low, high in zip(pos, FENCE_LOW, FENCE_HIGH, strict=True))
    return x, y, z


def eased(command: Command, tilt: float) -> Command:
    """Return ``command``, slowed while the base is tilted by ``tilt`` rad more than is easy."""
    share = max(0.0, min(1.0, (MOST_TILT - tilt) / (MOST_TILT - EASY_TILT)))
    forward, left, up = command.linear
    return replace(command, linear=(share * forward, share * left, up), yaw_rate=share * command.yaw_rate)


def tilt_of(rot6d: Sequence[float] | np.ndarray) -> float:
    """Return the angle in rad between a body's z axis and the vertical, from its rot6d."""
    x0, x1, _, y0, y1, _ = rot6d
    return math.acos(max(-1.0, min(1.0, x0 * y1 - x1 * y0)))
