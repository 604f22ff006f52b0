"""Watches what a robot shows over a link, and says when a policy is not to fly it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from aerial_il.core.specs import EnvSpec
from aerial_il.links.guard import Guard
from aerial_il.links.link import Mode, Reading

JUMP_S = 1.0  # a robot's clock that goes on by more from one reading to the next has jumped
FRESH_TICKS = 5  # as many new readings in a row end an interruption


class Watch:
    """Watches the readings of one robot.

    Args:
        guard: what must hold. spec: of the readings.

    Attributes:
        trouble: why the policy is not to fly now; empty if it may. over: whether the flight must end for it.
    """

    def __init__(self, guard: Guard, spec: EnvSpec) -> None:
        self._guard, self._spec = guard, spec
        self._stale_ticks = max(1, round(guard.stale_ms / 1000.0 / spec.control_dt_s))
        self.begin()

    def begin(self) -> None:
        """Begin a flight."""
        self._last, self._since, self._good = -np.inf, 0, FRESH_TICKS
        self.trouble, self.over = "", False

    @property
    def age(self) -> int:
        """Ticks since the newest reading came."""
        return self._since

    def see(self, reading: Reading | None) -> None:
        """Take note of the newest reading of this tick, which may be that of an earlier one."""
        new = reading is not None and reading.stamp_s != self._last
        self._since = 0 if new else self._since + 1
        problem = self._problem(reading)
        if reading is not None and new:
            self._last = reading.stamp_s
        self._good = 0 if problem else min(self._good + new, FRESH_TICKS)
        if problem or self._good == FRESH_TICKS:
            self.trouble = problem

    def _problem(self, reading: Reading | None) -> str:
        if self.over:
            return self.trouble
        if reading is None or self._since >= self._stale_ticks:
            return f"no news of the robot for {1000 * self._since * self._spec.control_dt_s:.0f} ms"
        if np.isfinite(self._last) and not 0.0 <= reading.stamp_s - self._last <= JUMP_S:
            return f"the robot's clock jumped by {reading.stamp_s - self._last:.3g} s"
        if missing := [name for name in self._spec.observation.names if name not in reading.obs]:
            return f"the robot does not show {', '.join(missing)}"
        if bad := not_finite(reading.obs):
            return f"{bad} is not finite"
        if reading.mode in (Mode.STANDING, Mode.LANDING):
            self.over = True
            return f"the robot is {reading.mode}"
        if (base := reading.obs.get("base_pos")) is not None:
            low, high = np.array(self._guard.fence[:3]), np.array(self._guard.fence[3:])
            if ((base < low) | (base > high)).any():
                self.over = True
                return f"the base is at {np.round(base, 2).tolist()}, beyond the fence"
        return ""


def not_finite(obs: Mapping[str, np.ndarray]) -> str:
    """Return the name of a field that is not finite; nothing if all are."""
    return next((name for name, value in obs.items() if not np.isfinite(value).all()), "")
