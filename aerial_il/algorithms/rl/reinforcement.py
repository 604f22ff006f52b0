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
    """Settings of reinforcement learning; stands before :class:`OffPolicy` or :class:`OnPolicy` among the bases.

    Attributes:
        reward: the ``environment``'s own, dense in the suite; or ``sparse``, 1 for success.
        reward_patience: environment steps after which a run stops whose rewards carry no information; 0 for never.
        smoothness: penalties for rough actions, and regularisers that hold the actor back from them.
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
    """Further settings of those that learn from a replay buffer.

    Attributes:
        hindsight: the other goals that past episodes are relabelled with.
        obs_norm: standardise observations by their moments in the warm-up, which are fixed from then on.
    """

    hindsight: Hindsight = field(default_factory=Hindsight)
    obs_norm: bool = False

    @property
    def forfeits_by_success(self) -> bool:
        return super().forfeits_by_success and not self.hindsight.goals  # with it critics bootstrap through success

    def ways_to_reward(self) -> Iterator[str]:
        yield from super().ways_to_reward()
        if not self.hindsight.goals:
            yield "hindsight, where the task exposes a goal (algorithm.hindsight.goals=4)"
