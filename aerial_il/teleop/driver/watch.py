"""When a person who watches a policy takes over, and when they let it have its way again."""

import math
from dataclasses import dataclass

IN_A_ROW = 150  # ticks, beside one's patience, after handing back: in trouble again by then, it gets no other chance


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """By what a flight is judged.

    Attributes:
        patience_ticks: without getting on by ``step_m`` for so long, it is stuck.
        step_m: what counts as getting on. astray_m: so much more left than it was at its best, for ``sure_ticks``, it
            has gone astray.
        enough_m: what the person does before they hand back; when the policy is soon in trouble again, they finish.
        least_ticks: for which they fly at least.
    """

    patience_ticks: int = 400
    step_m: float = 0.02
    astray_m: float = 0.3
    sure_ticks: int = 50
    enough_m: float = 0.10
    least_ticks: int = 25


class Watch:
    """Watches how much is left to do, tick by tick, and says whether take-over is held.

    Nobody lets go in the midst of something delicate, such as a grasp: what is handed back is a part that is done.
    """

    def __init__(self, judgement: Judgement) -> None:
        self._by, self._enough = judgement, judgement.enough_m
        self.holds, self._tick, self._best, self._got_on = False, 0, math.inf, 0
        self._left_then, self._taken, self._handed_back, self._astray = 0.0, 0, -math.inf, 0

    def judge(self, left: float, *, delicate: bool = False) -> bool:
        """Return whether take-over is held now that so much (m) is left to do; ``delicate``: what is done by hand."""
        self._tick += 1
        if left < self._best - self._by.step_m:
            self._best, self._got_on = left, self._tick
        self._astray = self._astray + 1 if left > self._best + self._by.astray_m else 0
        if self.holds and not delicate and self._is_content(left):
            self.holds, self._handed_back = False, self._tick
            self._best, self._got_on, self._astray = left, self._tick, 0
        elif not self.holds and self._worries():
            again = self._tick - self._handed_back < self._by.patience_ticks + IN_A_ROW
            self._enough = math.inf if again else self._by.enough_m
            self.holds, self._left_then, self._taken = True, left, self._tick
        return self.holds

    def _worries(self) -> bool:
        stuck = self._tick - self._got_on > self._by.patience_ticks
        return stuck or self._astray > self._by.sure_ticks

    def _is_content(self, left: float) -> bool:
        long_enough = self._tick - self._taken >= self._by.least_ticks
        return long_enough and self._left_then - left >= self._enough
