"""From sticks and keys to smooth motions in [-1, 1]: dead zone, expo, ramps and limits of acceleration, in ticks."""

import math
from collections.abc import Mapping

from aerial_il.teleop.input.mapping import MOTIONS, Intent

DEAD_ZONE, EXPO = 0.12, 0.3
RAMP = 1 / 7.5  # per tick: keys take 150 ms from rest to full, so that actions are no steps of one
ACCELERATION, BRAKING = 0.16, 0.3  # per tick
STICKS = (("forward", "lateral"), ("up", "yaw"))


class Shaper:
    """Shapes one person's intent; depends on nothing but the intents it was given, tick by tick."""

    def __init__(self) -> None:
        self.stop()

    def stop(self) -> None:
        """Stand still at once."""
        self._keys = dict.fromkeys(MOTIONS, 0.0)
        self._shaped = dict.fromkeys(MOTIONS, 0.0)

    def step(self, intent: Intent) -> Mapping[str, float]:
        """Return each motion in [-1, 1] for the coming tick."""
        sticks = {m: expo(value) for m, value in without_dead_zone(intent.analogue).items()}
        for motion in MOTIONS:
            self._keys[motion] = toward(self._keys[motion], intent.digital.get(motion, 0.0), RAMP, BRAKING)
            wanted = max(-1.0, min(1.0, sticks[motion] + self._keys[motion]))
            self._shaped[motion] = toward(self._shaped[motion], wanted, ACCELERATION, BRAKING)
        return dict(self._shaped)


def without_dead_zone(analogue: Mapping[str, float]) -> dict[str, float]:
    """Return stick positions of which those near the middle count as zero and the rest begins at zero.

    The zone of a stick is round: one that is pushed straight ahead keeps its small sideways part.
    """
    shaped = dict.fromkeys(MOTIONS, 0.0)
    grouped = {motion for stick in STICKS for motion in stick}
    for stick in (*STICKS, *((motion,) for motion in MOTIONS if motion not in grouped)):
        values = [analogue.get(motion, 0.0) for motion in stick]
        length = math.hypot(*values)
        share = max(0.0, min(1.0, (length - DEAD_ZONE) / (1.0 - DEAD_ZONE))) / max(length, 1e-9)
        shaped |= {motion: share * value for motion, value in zip(stick, values, strict=True)}
    return shaped


def expo(value: float) -> float:
    """Return ``(1 - e) v + e v³``: fine near the middle, everything at the end."""
    return (1.0 - EXPO) * value + EXPO * value**3


def toward(value: float, wanted: float, rise: float, fall: float) -> float:
    """Move ``value`` to ``wanted`` by at most ``rise``, or by at most ``fall`` where that brakes."""
    braking = wanted * value < 0.0 or abs(wanted) < abs(value)
    change = fall if braking else rise
    return value + max(-change, min(change, wanted - value))
