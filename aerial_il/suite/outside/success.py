"""Success criteria for environments from outside, written as short strings that can be stored."""

from __future__ import annotations

import re
from dataclasses import dataclass

from aerial_il.core.errors import InvalidValueError

SURVIVED, RETURN = "survived", "return"
REPORTED = ("success", "is_success")  # entries of ``info`` by which environments commonly say so
_COUNT, _RETURN = re.compile(r"([\w.]+):(\d+)"), re.compile(r"return:(-?\d+(?:\.\d+)?(?:e[+-]?\d+)?)")
FORMS = "KEY:N (info[KEY] was true in more than N steps), return:R (at least R) or survived (flew to the time limit)"


@dataclass(frozen=True)
class SuccessRule:
    """Success condition of an episode from outside.

    Attributes:
        text: the rule in words, e.g. ``success:25``. key: the entry of ``info``, ``return`` or ``survived``.
        limit: steps that the entry must be exceeded by, or the least return.
    """

    text: str
    key: str
    limit: float = 0.0

    @staticmethod
    def of(text: str) -> SuccessRule:
        """Read a rule.

        Raises:
            InvalidValueError: it has none of the known forms.
        """
        if text == SURVIVED:
            return SuccessRule(text, SURVIVED)
        if found := _RETURN.fullmatch(text):
            return SuccessRule(text, RETURN, float(found[1]))
        if found := _COUNT.fullmatch(text):
            return SuccessRule(text, found[1], float(found[2]))
        raise InvalidValueError(f"success={text} is no rule; one is {FORMS}.")

    @property
    def reported(self) -> str | None:
        """The entry of ``info`` that is counted, or None."""
        return None if self.key in (SURVIVED, RETURN) else self.key

    def holds(self, *, count: int, total_reward: float, survived: bool) -> bool:
        """Judge an episode so far.

        Args:
            count: steps in which ``info[key]`` was true. total_reward: sum of rewards. survived: the time limit is
                reached, and the environment has not terminated.
        """
        if self.key == SURVIVED:
            return survived
        return total_reward >= self.limit if self.key == RETURN else count > self.limit
