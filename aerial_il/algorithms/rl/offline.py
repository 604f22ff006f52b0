"""Settings of offline-to-online algorithms: they learn from a dataset first, then from their own flights."""

from __future__ import annotations

from dataclasses import dataclass

from aerial_il.algorithms.rl.demonstrated import RelabelledDemonstrated
from aerial_il.algorithms.rl.off_policy import OffPolicyActorCritic
from aerial_il.algorithms.rl.replay.replay_buffer import Batch, ReplayBuffer, mixed
from aerial_il.algorithms.run.checks import require_not_negative, require_share


@dataclass(frozen=True, kw_only=True)
class OfflineFirst(RelabelledDemonstrated, OffPolicyActorCritic):
    """Their settings; ``warmup`` are the environment steps that the policy flies before it goes on learning.

    Attributes:
        offline_steps: gradient steps on the dataset before the first flight. With 0 the warm-up is flown at random.
        demos_share: share of the dataset in each minibatch once it flies.
    """

    warmup: int = 1_000
    actor_every: int = 1
    offline_steps: int = 50_000
    demos_share: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "offline_steps")
        require_share(self, "demos_share")

    def flown_before_learning(self, worlds: int) -> dict[str, int]:
        return {} if self.offline_steps else super().flown_before_learning(worlds)

    def minibatch(self, demos: ReplayBuffer, flown: ReplayBuffer) -> Batch:
        """Return transitions of both, in the shares that the settings specify."""
        return mixed(demos, flown, self.batch_size, self.demos_share)
