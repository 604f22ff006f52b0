"""How steps are rewarded, by an algorithm's settings, and what can be done where no reward comes."""

from __future__ import annotations

from typing import ClassVar, Literal, Protocol

from aerial_il.algorithms.online.collector import RewardScheme
from aerial_il.algorithms.online.smoothness import Smoothness

Source = Literal["environment", "sparse"]
BEGIN = "an algorithm that begins with demonstrations (algorithm=bc_ppo dataset=PATH)"


class Rewarded(Protocol):
    """What decides how steps are rewarded."""

    demonstrated: ClassVar[bool]

    @property
    def reward(self) -> Source: ...
    @property
    def reward_patience(self) -> int: ...
    @property
    def smoothness(self) -> Smoothness: ...


def reward_scheme(settings: Rewarded, *further: str) -> RewardScheme:
    """Return how steps are rewarded, with advice for where no reward comes: ways out that all have, and ``further``."""
    sparse = settings.reward == "sparse"
    ways = ["more demonstrations, or a better prior" if settings.demonstrated else BEGIN]
    ways += ["a dense reward (algorithm.reward=environment)"] if sparse else []
    advice = f"Ways out: {'; '.join([*ways, *further])}."
    return RewardScheme(sparse=sparse, smoothness=settings.smoothness, patience=settings.reward_patience, advice=advice)


def forfeits_by_success(settings: object) -> bool:
    """Whether an episode that success ends forfeits the environment's reward for the steps it might have had.

    It does not where the reward is sparse or learned, and where critics bootstrap through success: with hindsight, or
    by an absorbing state.
    """
    hindsight, shown = getattr(settings, "hindsight", None), getattr(settings, "demonstrations", None)
    goes_on = getattr(hindsight, "goals", 0) > 0 or getattr(shown, "absorbing", False)
    return getattr(settings, "reward", None) == "environment" and not goes_on
