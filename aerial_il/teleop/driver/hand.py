"""A hand on two sticks: what a person wants as positions of sticks, with tremor, and stops between two movements."""

import math
from collections import deque

import numpy as np

from aerial_il.teleop.driver.habit import Habit
from aerial_il.teleop.driver.plan import Wish
from aerial_il.teleop.piloting.command import PRECISION, TOOL_SPEED, TURN_RATE, YAW_RATE
from aerial_il.teleop.piloting.shaping import DEAD_ZONE, EXPO

TURN_GAIN = 1.3  # 1/s
FORESEEN = 0.8  # share of one's own movement since what is seen now that one reckons with
TREMOR_TICKS = 6.0
SMALL = 0.02  # a wish for less than this share of full speed is none


class Hand:
    """Moves the sticks.

    Args:
        habit: of this flight. reaction_ticks: how old what is seen is. dt: s, of a tick. rng: of tremor and stops.
    """

    def __init__(self, habit: Habit, *, reaction_ticks: int, dt: float, rng: np.random.Generator) -> None:
        self._habit, self._dt, self._rng = habit, dt, rng
        self._moved: deque[np.ndarray] = deque(maxlen=reaction_ticks)
        self._tremor, self._rest, self._part = np.zeros(4), 0, ""

    def rest(self) -> None:
        """Let go of the sticks."""
        self._moved.clear()
        self._rest, self._part = 0, ""

    def sticks(self, wish: Wish) -> tuple[float, float, float, float]:
        """Return positions in [-1, 1] of: right stick ahead, right stick left, left stick up, left stick turn left."""
        rates = np.zeros(6) if self._stops(wish) else self._rates(wish)
        self._moved.append(rates * self._dt)
        share = PRECISION if wish.fine else 1.0
        ahead, left, up, yaw, nose, roll = rates
        if wish.mode == "wrist":
            wanted = (nose / TURN_RATE, -roll / TURN_RATE, up / TOOL_SPEED, yaw / YAW_RATE)
        else:
            wanted = (ahead / TOOL_SPEED, left / TOOL_SPEED, up / TOOL_SPEED, yaw / YAW_RATE)
        keep = 1.0 - 1.0 / TREMOR_TICKS
        self._tremor = keep * self._tremor + math.sqrt(1.0 - keep * keep) * self._rng.normal(size=4)
        shaken = [_shaken(w / share, self._habit.tremor * t) for w, t in zip(wanted, self._tremor, strict=True)]
        return (*_stick(shaken[0], shaken[1]), *_stick(shaken[2], shaken[3]))

    def _stops(self, wish: Wish) -> bool:
        """Return whether the hand is still: a new part of the task starts, or it just stops for a moment."""
        if wish.part != self._part:
            self._rest = int(self._rng.exponential(self._habit.pause_ticks)) if self._part else 0
            self._part = wish.part
        elif not self._rest and self._rng.random() < self._habit.stops:
            self._rest = int(self._rng.uniform(10, 40))
        self._rest = max(0, self._rest - 1)
        return self._rest > 0

    def _rates(self, wish: Wish) -> np.ndarray:
        """Return ahead, left, up (m/s), yaw to the left, nose down, right side down (rad/s)."""
        foreseen = FORESEEN * sum(self._moved, np.zeros(6))
        offset, turn = np.array(wish.offset) - foreseen[:3], np.array(wish.turn) - foreseen[3:]
        offset = np.where(np.array(wish.offset) == 0.0, 0.0, offset)
        turn = np.where(np.array(wish.turn) == 0.0, 0.0, turn)
        speed = self._habit.speed * (PRECISION if wish.fine else 1.0)
        velocity = self._habit.gain * offset
        velocity *= min(1.0, speed / max(float(np.linalg.norm(velocity)), 1e-9))
        most = np.array([YAW_RATE, TURN_RATE, TURN_RATE]) * (PRECISION if wish.fine else 1.0)
        return np.concatenate([velocity, np.clip(TURN_GAIN * turn, -most, most)])


def _shaken(wanted: float, tremor: float) -> float:
    """Return a share of full speed as a hand gives it: none where none is wanted, else with its tremor."""
    return 0.0 if abs(wanted) < SMALL else wanted + tremor


def _stick(one: float, other: float) -> tuple[float, float]:
    """Return the position at which a stick gives two shares of full speed: a person has learned dead zone and expo."""
    one, other = _before_expo(one), _before_expo(other)
    length = math.hypot(one, other)
    if length == 0.0:
        return 0.0, 0.0
    pushed = min(1.0, DEAD_ZONE + (1.0 - DEAD_ZONE) * length) / length
    return max(-1.0, min(1.0, pushed * one)), max(-1.0, min(1.0, pushed * other))


def _before_expo(value: float) -> float:
    """Return v of which ``(1 - e) v + e v³`` is ``value``, within [-1, 1]."""
    value = max(-1.0, min(1.0, value))
    root = value
    for _ in range(4):
        root -= ((1.0 - EXPO) * root + EXPO * root**3 - value) / (1.0 - EXPO + 3.0 * EXPO * root**2)
    return root
