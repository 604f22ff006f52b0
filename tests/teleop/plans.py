"""How a person flies tasks by the numbers on the page: plans, from what is seen to what is wished for.

All lengths are centimetres, all angles degrees, as the page has them.
"""

import math
import time

from tests.teleop.page_reader import Sight, Wish

NEAR_CM = 14.0  # from here on slowly


class Reach:
    """Turn as is asked, wrist and all, then go there; turn again what has come undone."""

    POSITION, ANGLE, TILTED = 0.9, 3.0, 6.0

    def __init__(self) -> None:
        self._tilting = False

    def __call__(self, sight: Sight) -> Wish:
        ahead, left, up = sight.numbers["tool to target, cm"]
        yaw, pitch, roll = sight.numbers["turn to target"]
        worst, far = max(abs(pitch), abs(roll)), math.hypot(ahead, left, up)
        self._tilting = worst > (self.ANGLE if self._tilting else self.TILTED)
        if self._tilting:
            turns = {"forward": (pitch, self.ANGLE), "lateral": (-roll, self.ANGLE), "yaw": (yaw, self.ANGLE)}
            return Wish(turns, "wrist", precise=max(worst, abs(yaw)) < 20.0)
        moves = {"forward": (ahead, self.POSITION), "lateral": (left, self.POSITION), "up": (up, self.POSITION)}
        return Wish(moves | {"yaw": (yaw, self.ANGLE)}, precise=far < NEAR_CM)


class PickPlace:
    """Over the cube, down, close, up, over the bowl, down, let go, away."""

    ABOVE, LIFT, CENTRED, LOST, ANGLE = 10.0, 14.0, 1.0, 3.0, 4.0
    AT_CUBE, IN_BOWL, OPEN = 0.8, 4.6, 90.0
    PATIENCE_S = 1.5

    def __init__(self) -> None:
        self.doing, self._since, self._lifted_to = "approach", time.monotonic(), 0.0

    def _now(self, doing: str) -> None:
        self.doing, self._since = doing, time.monotonic()

    def __call__(self, sight: Sight) -> Wish:
        """Return the wish of what is being done, after having decided whether that is over."""
        return getattr(self, f"_{self.doing}")(sight)

    def _approach(self, sight: Sight) -> Wish:
        ahead, left, up = sight.numbers["tool to cube, cm"]
        (yaw,) = sight.numbers["turn to cube"]
        over, high = math.hypot(ahead, left), up + self.ABOVE
        if over < self.CENTRED and abs(yaw) < self.ANGLE + 1.0 and high > -4.0 and self._open(sight):
            self._now("descend")
        moves = {"forward": (ahead, 0.6), "lateral": (left, 0.6), "up": (high, 1.5), "yaw": (yaw, self.ANGLE)}
        grip = 0 if self._open(sight) else -1
        return Wish(moves, precise=max(over, abs(high)) < NEAR_CM, grip=grip)

    def _descend(self, sight: Sight) -> Wish:
        ahead, left, up = sight.numbers["tool to cube, cm"]
        if math.hypot(ahead, left) > self.LOST:
            self._now("approach")
        if up > -self.AT_CUBE:
            self._now("close")
        centred = math.hypot(ahead, left) < 1.5 * self.CENTRED
        down = up if centred or up > -3.0 else 0.0
        return Wish({"forward": (ahead, 0.6), "lateral": (left, 0.6), "up": (down, 0.5)}, precise=True)

    def _close(self, sight: Sight) -> Wish:
        waited = time.monotonic() - self._since
        if "grasped" in sight.ticks and waited > 0.5:
            self._lifted_to = sight.numbers["tool height, cm"][0] + self.LIFT
            self._now("lift")
        elif waited > self.PATIENCE_S:
            self._now("reopen")
        return Wish(grip=1)

    def _reopen(self, sight: Sight) -> Wish:
        if self._open(sight):
            self._now("approach")
        return Wish({"up": (3.0, 0.0)}, grip=-1)

    def _lift(self, sight: Sight) -> Wish:
        left_to_go = self._lifted_to - sight.numbers["tool height, cm"][0]
        self._check(sight)
        if left_to_go < 1.5:
            self._now("carry")
        return Wish({"up": (left_to_go, 1.0)}, precise=left_to_go > 10.0 or left_to_go < 5.0)

    def _carry(self, sight: Sight) -> Wish:
        ahead, left, _ = sight.numbers["cube to bowl, cm"]
        over = math.hypot(ahead, left)
        self._check(sight)
        if over < 1.6:
            self._now("lower")
        return Wish({"forward": (ahead, 0.8), "lateral": (left, 0.8)}, precise=over < NEAR_CM)

    def _lower(self, sight: Sight) -> Wish:
        ahead, left, up = sight.numbers["cube to bowl, cm"]
        if up > -self.IN_BOWL or ("grasped" not in sight.ticks and math.hypot(ahead, left) < 4.0 and up > -7.0):
            self._now("release")
        else:
            self._check(sight)
        down = up + self.IN_BOWL - 0.6 if math.hypot(ahead, left) < 3.0 else 0.0
        return Wish({"forward": (ahead, 0.8), "lateral": (left, 0.8), "up": (down, 0.2)}, precise=True)

    def _release(self, sight: Sight) -> Wish:
        if self._open(sight):
            self._now("retreat")
        return Wish(grip=-1)

    def _retreat(self, sight: Sight) -> Wish:
        _, _, up = sight.numbers["tool to cube, cm"]
        if up < -15.0 and "in bowl" not in sight.ticks and time.monotonic() - self._since > 4.0:
            self._now("approach")
        return Wish({"up": (up + 17.0, 1.5)}, precise=up > -5.0)

    def _check(self, sight: Sight) -> None:
        """Begin anew if the cube has been lost."""
        if math.hypot(*sight.numbers["tool to cube, cm"]) > 5.0:
            self._now("reopen")

    def _open(self, sight: Sight) -> bool:
        return sight.numbers["gripper"][0] >= self.OPEN


class PressButton:
    """Close the gripper, over the button, slowly down until it is pressed, and wait."""

    ABOVE, NEAR, CENTRED, LOST = 8.0, 30.0, 0.8, 2.5  # come down on it fast and it is hit hard
    DEEP_CM = 1.15  # success asks for 0.8, the stop is at 2
    TOO_HARD_N = 15.0  # nothing is to be gained any more

    def __init__(self) -> None:
        self._pressing = False

    def __call__(self, sight: Sight) -> Wish:
        ahead, left, up = sight.numbers["tip to button, cm"]
        (travel,) = sight.numbers["button travel, cm"]
        if sight.numbers["peak force, N"][0] > self.TOO_HARD_N:
            return Wish(over=True)
        grip = 1 if sight.numbers["gripper"][0] > 3.0 else 0
        over = math.hypot(ahead, left)
        if over < self.CENTRED and abs(up + self.ABOVE) < 3.0 and not grip:
            self._pressing = True
        if over > self.LOST:
            self._pressing = False
        moves = {"forward": (ahead, 0.5), "lateral": (left, 0.5)}
        if not self._pressing:
            high = up + self.ABOVE
            return Wish(moves | {"up": (high, 1.0)}, precise=math.hypot(over, high) < self.NEAR, grip=grip)
        if travel > 0.1:  # down by what is left of it, sideways no more
            return Wish({"up": (travel - self.DEEP_CM, 0.25)}, precise=True)
        return Wish(moves | {"up": (min(-0.4, 0.6 * (up + 0.2)), 0.0)}, precise=True)


PLANS = {"reach": Reach, "pick_place": PickPlace, "press_button": PressButton}
