"""The base of agents that learn from rollouts: an actor and the critic that judges its decisions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aerial_il.algorithms.on_policy.critic import Critic
from aerial_il.algorithms.run.state import Snapshot, joined, separate
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.policies.parts.network import StochasticNetwork


class ActorCritic[Actor: StochasticNetwork]:
    """Both in training, each with its optimiser; what they learn stands in the file of each algorithm.

    There they are made with ``settings``, the algorithm's, too.

    Args:
        actor: the policy's network. obs_size: Do. critic_hidden: the critic's widths. lr: learning rate of both.
    """

    def __init__(self, actor: Actor, obs_size: int, critic_hidden: Sequence[int], *, lr: float) -> None:
        self.actor, self._actor = actor, TrainState(actor, adam(actor, lr))
        self._critic = Critic(obs_size, critic_hidden, lr=lr)

    def values(self, obs: np.ndarray) -> np.ndarray:
        """Return the critic's values (...) of what decisions see (..., Do)."""
        return self._critic.values(obs)

    def snapshot(self) -> Snapshot:
        return Snapshot(joined({"actor": self._actor, "critic": self._critic}).arrays)

    def restore(self, saved: Snapshot) -> None:
        separate(saved, {"actor": self._actor, "critic": self._critic})
