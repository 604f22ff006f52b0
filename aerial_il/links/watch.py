"""Watches what a robot shows over a link, and says when a policy is not to fly it."""

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
        hovers: whether the robot holds by itself though it has followed set points before.
        age_s: how long ago the newest reading came, s of the robot's time.
    """

    def __init__(self, guard: Guard, spec: EnvSpec) -> None:
        self._guard, self._spec = guard, spec
        self._stale_s = max(guard.stale_ms / 1000.0, spec.control_dt_s) - 0.5 * spec.control_dt_s
        self.begin()

    def begin(self) -> None:
        """Begin a flight."""
        self._last, self._came_s, self._good = -np.inf, np.nan, FRESH_TICKS
        self.trouble, self.over, self.age_s = "", False, 0.0
        self.hovers = self._followed = False

    def see(self, reading: Reading | None, now_s: float) -> None:
        """Take note of the newest reading of this tick, which may be that of an earlier one.

        Args:
            reading: the newest. now_s: the time at which it is looked at, s, as fast as the robot's: ticks that make up
                for lost time look at one reading again and again, which is none the older for it.
        """
        new = reading is not None and reading.stamp_s != self._last
        if new or np.isnan(self._came_s):
            self._came_s = now_s
        self.age_s = now_s - self._came_s
        problem = self._problem(reading)
        if reading is not None and new:
            self._last = reading.stamp_s
            self._followed |= reading.mode is Mode.FLYING
            self.hovers = self._followed and reading.mode is Mode.HOLDING
        self._good = 0 if problem else min(self._good + new, FRESH_TICKS)
        if problem or self._good == FRESH_TICKS:
            self.trouble = problem

    def _problem(self, reading: Reading | None) -> str:
        if self.over:
            return self.trouble
        if reading is None or self.age_s > self._stale_s:
            return f"no news of the robot for {1000 * self.age_s:.0f} ms"
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
