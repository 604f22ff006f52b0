"""Settings of algorithms that learn from a reward: which one, how long to wait for it, and how smoothly to act."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from aerial_il.algorithms.online.collector import RewardScheme
from aerial_il.algorithms.online.smoothness import NO_SMOOTHNESS, Smoothness
from aerial_il.algorithms.rl.algorithm import OnlineAlgorithm
from aerial_il.algorithms.run.checks import require_choice, require_not_negative

Reward = Literal["environment", "sparse"]


@dataclass(frozen=True, kw_only=True)
class Reinforcement(OnlineAlgorithm):
    """Settings of reinforcement learning; stands before :class:`OffPolicy` or :class:`OnPolicy` among the bases.

    Attributes:
        reward: the ``environment``'s own, dense in the suite; or ``sparse``, 1 for success. With hindsight it is the
            environment's own rule for goals.
        reward_patience: environment steps after which a run stops whose rewards carry no information; 0 for never.
        smoothness: penalties for rough actions, and regularisers that hold the actor back from them.
    """

    reward: Reward = "environment"
    reward_patience: int = 200_000
    smoothness: Smoothness = NO_SMOOTHNESS

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice(self, "reward", Reward)
        require_not_negative(self, "reward_patience")

    @property
    def scheme(self) -> RewardScheme:
        sparse = self.reward == "sparse"
        advice = f"Ways out: {'; '.join(self.ways_to_reward())}."
        return RewardScheme(sparse=sparse, smoothness=self.smoothness, patience=self.reward_patience, advice=advice)

    @property
    def forfeits_by_success(self) -> bool:
        """Whether an episode that success ends forfeits the environment's reward for the steps it might have had."""
        return self.reward == "environment"

    def ways_to_reward(self) -> Iterator[str]:
        """Yield what can be done where no reward has come."""
        if self.demonstrated:
            yield "more demonstrations, or a better prior"
        else:
            yield "an algorithm that begins with demonstrations (algorithm=bc_ppo dataset=PATH)"
        if self.reward == "sparse":
            yield "a dense reward (algorithm.reward=environment)"
