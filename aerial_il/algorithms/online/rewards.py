"""How steps are rewarded, by an algorithm's settings, and what can be done where no reward comes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from aerial_il.algorithms.online.collector import RewardScheme

if TYPE_CHECKING:
    from aerial_il.algorithms.online.algorithm import Algorithm

Source = Literal["environment", "sparse"]
SHOWN = "an algorithm that starts with demonstrations (algorithm=bc_ppo dataset=PATH)"


def reward_scheme(settings: Algorithm) -> RewardScheme:
    """Return how steps are rewarded, with advice for where no reward comes."""
    sparse, hindsight = settings.reward == "sparse", getattr(settings, "hindsight", None)
    ways = ["more demonstrations, or a better prior" if settings.demonstrated else SHOWN]
    ways += ["a dense reward (algorithm.reward=environment)"] if sparse else []
    if hindsight is not None and not hindsight.goals:
        also = " algorithm.reward=environment" if sparse else ""
        ways += [f"hindsight, where the task exposes a goal (algorithm.hindsight.goals=4{also})"]
    advice = f"Ways out: {'; '.join(ways)}."
    return RewardScheme(sparse=sparse, smoothness=settings.smoothness, patience=settings.reward_patience, advice=advice)


def forfeits_by_success(settings: object) -> bool:
    """Whether an episode that success ends forfeits the environment's reward for the steps it might have had.

    It does not where the reward is sparse or learned, and where critics bootstrap through success: with hindsight, or
    by an absorbing state.
    """
    hindsight, shown = getattr(settings, "hindsight", None), getattr(settings, "demonstrations", None)
    goes_on = getattr(hindsight, "goals", 0) > 0 or getattr(shown, "absorbing", False)
    return getattr(settings, "reward", None) == "environment" and not goes_on
