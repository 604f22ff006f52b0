"""Settings of algorithms that learn from a reward: which one, how long to wait for it, and how smoothly to act."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from aerial_il.algorithms.rl.algorithm import OnlineAlgorithm
from aerial_il.algorithms.rl.collector import RewardScheme
from aerial_il.algorithms.rl.replay.hindsight import Hindsight
from aerial_il.algorithms.rl.smoothness import Smoothness
from aerial_il.algorithms.run.checks import require_choice, require_not_negative

Reward = Literal["environment", "sparse"]


@dataclass(frozen=True, kw_only=True)
class Reinforcement(OnlineAlgorithm):
    """What learners from a reward are given; stands before :class:`OffPolicy` or :class:`OnPolicy` among the bases.

    Attributes:
        reward: what pays: the ``environment``'s own reward, dense in the suite; or ``sparse``, 1 for success.
        reward_patience: environment steps after which a run stops whose rewards carry no information; 0 for never.
        smoothness: what rough actions cost, and how the actor is held back from them.
    """

    reward: Reward = "environment"
    reward_patience: int = 200_000
    smoothness: Smoothness = field(default_factory=Smoothness)

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


@dataclass(frozen=True, kw_only=True)
class OffPolicyReinforcement(Reinforcement):
    """What learners from a replay buffer are given besides.

    Attributes:
        hindsight: what else past episodes are taken for to have pursued.
        obs_norm: standardise observations by their moments in the warm-up; they stay as they are then.
    """

    hindsight: Hindsight = field(default_factory=Hindsight)
    obs_norm: bool = False

    @property
    def forfeits_by_success(self) -> bool:
        return super().forfeits_by_success and not self.hindsight.goals  # with it critics bootstrap beyond success

    def ways_to_reward(self) -> Iterator[str]:
        yield from super().ways_to_reward()
        if not self.hindsight.goals:
            yield "hindsight, where the task exposes a goal (algorithm.hindsight.goals=4)"
