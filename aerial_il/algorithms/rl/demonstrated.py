"""Settings of reinforcement learning with demonstrations."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

from aerial_il.algorithms.online.demonstrations import MEANT
from aerial_il.algorithms.online.problem import Problem
from aerial_il.algorithms.online.rewarded_demonstrations import check_lengths, check_paid, with_rewards
from aerial_il.algorithms.rl.imitation import Imitation
from aerial_il.algorithms.rl.reinforcement import Reinforcement
from aerial_il.core.contracts import BatchEnv
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.network import PolicySettings


@dataclass(frozen=True, kw_only=True)
class DemonstratedReinforcement(Reinforcement, Imitation):
    """Settings of reinforcement learning with demonstrations; stands before :class:`OffPolicy` among the bases.

    Beside those of :class:`Imitation`, of which ``control`` cannot be ``constant_reward`` here:

    Attributes:
        failures: learn from failed episodes of the dataset too; rewards tell them from the others.
        absorbing: whether success that ends an episode leads to an absorbing state with its reward; a crash never does.
    """

    rewarded: ClassVar[bool] = True

    failures: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.control == "constant_reward":
            raise InvalidValueError(f"{self.name} learns from a reward: control is none or random_actions.")
        if self.labels == "expert":
            raise InvalidValueError(MEANT)

    @property
    def learns_from_failures(self) -> bool:
        return self.failures

    @property
    def learns_recorded_rewards(self) -> bool:
        """Whether what demonstrations were paid, or their success, has to say something."""
        return self.control == "none"

    @property
    def forfeits_by_success(self) -> bool:
        return super().forfeits_by_success and not self.absorbing

    def problem(self, dataset: Iterable[Episode] | None, policy: PolicySettings, env: BatchEnv, seed: int) -> Problem:
        """Read the demonstrations and reward them as the learner is rewarded.

        Raises:
            InvalidValueError: they carry no reward that could be learned from, or are longer than episodes here.
        """
        episodes = list(dataset or ())
        check_lengths(episodes, env.spec)
        if self.learns_recorded_rewards:
            check_paid(episodes, sparse=self.reward == "sparse")
        return super().problem([with_rewards(e, self.scheme, env) for e in episodes], policy, env, seed)
