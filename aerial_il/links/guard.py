"""What must hold for a policy to fly a robot over a link; where it does not, the robot hovers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from aerial_il.core.checks import make_tuples, require_positive
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec
from aerial_il.links.link import Mode, Reading

JUMP_S = 1.0  # a robot's clock that goes on by more from one reading to the next has jumped
FRESH_TICKS = 5  # as many new readings in a row end an interruption


@dataclass(frozen=True, kw_only=True)
class Guard:
    """When a policy is not asked, and where the robot may be.

    Attributes:
        stale_ms: without a new reading for longer, set points are held back, so that the robot hovers.
        fence: corners of the box that the base must stay in, m: low x, y, z, high x, y, z.
    """

    stale_ms: float = 80.0
    fence: tuple[float, ...] = (-3.5, -3.5, 0.0, 3.5, 3.5, 3.5)

    def __post_init__(self) -> None:
        make_tuples(self)
        require_positive(self, "stale_ms")
        low, high = self.fence[:3], self.fence[3:]
        if len(self.fence) != 6 or not all(a < b for a, b in zip(low, high, strict=True)):
            raise InvalidValueError(
                f"fence is {list(self.fence)}; it must be six numbers, each of the first three below its partner, "
                "e.g. [-2,-2,0.2,2,2,3]."
            )


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
