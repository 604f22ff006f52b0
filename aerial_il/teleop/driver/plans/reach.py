"""Reach by hand: go there, then turn the tool, then put right what the turning has moved."""

import math

from aerial_il.teleop.driver.eyes import Sight
from aerial_il.teleop.driver.habit import Habit
from aerial_il.teleop.driver.plan import Wish

NEAR_M, FAR_M = 0.03, 0.06
TURNED_RAD, ASKEW_RAD = 0.06, 0.13


class ReachPlan:
    """Alternates between going and turning, and is content where both are small."""

    def begin(self, sight: Sight, habit: Habit) -> None:
        self._turning, self._yaw_first = False, habit.turns_first

    def wish(self, sight: Sight) -> Wish:
        offset, (yaw, nose, roll) = sight.numbers["tool to target"], sight.numbers["turn to target"]
        distance, askew = math.hypot(*offset), math.hypot(nose, roll)
        if self._turning:
            self._turning = askew > TURNED_RAD and distance < 0.3
        else:
            self._turning = askew > ASKEW_RAD and distance < NEAR_M
        if self._turning:
            return Wish("turn", turn=(yaw, nose, roll), mode="wrist", fine=askew < 0.25)
        turned = yaw if self._yaw_first or distance < 0.2 else 0.0
        return Wish("go", offset=_three(offset), turn=(turned, 0.0, 0.0), fine=distance < 0.1)

    def left(self, sight: Sight) -> float:
        return math.hypot(*sight.numbers["tool to target"]) + 0.1 * math.hypot(*sight.numbers["turn to target"])


def _three(values: tuple[float, ...]) -> tuple[float, float, float]:
    ahead, left, up = values
    return ahead, left, up


PLAN = ReachPlan
