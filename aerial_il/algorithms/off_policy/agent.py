"""The base of off-policy agents: networks in training, as one part of a run's state."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch

from aerial_il.algorithms.run.state import Snapshot, Stateful, joined, separate
from aerial_il.algorithms.run.train_state import Follower, TrainState
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts.network import StochasticNetwork


class Agent[Network: StochasticNetwork]:
    """Networks in training and their target networks; what they learn stands in the file of each algorithm.

    There they are made with ``settings``, the algorithm's, ``actor``, the policy's network, and ``sizes``, Do and Da.

    Args:
        trained: by the names that their state is kept under. targets: likewise. others: whatever else changes.

    Attributes:
        actor: the policy's network, set by each agent.
        updates: gradient steps of the critics so far.
    """

    actor: Network

    def __init__(
        self,
        trained: Mapping[str, TrainState],
        targets: Mapping[str, Follower],
        others: Mapping[str, Stateful] | None = None,
    ) -> None:
        self._trained, self.updates = trained, 0
        self._parts: Mapping[str, Stateful] = {**trained, **targets, **(others or {})}

    @torch.no_grad()
    def explore(self, obs: np.ndarray) -> np.ndarray:
        """Return normalised actions (n, Da) to explore with, for encoded observations (n, Do): samples of the actor."""
        return self.actor.sample(tensor(obs)[:, None])[0].numpy()

    def set_lr(self, lr: float) -> None:
        """Take all steps that follow at the learning rate ``lr``."""
        for part in self._trained.values():
            part.set_lr(lr)

    def snapshot(self) -> Snapshot:
        return Snapshot(joined(self._parts).arrays, {"updates": self.updates})

    def restore(self, saved: Snapshot) -> None:
        separate(saved, self._parts)
        self.updates = saved.values["updates"]
