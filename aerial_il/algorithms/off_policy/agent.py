"""The base of off-policy agents: networks in training, as one part of a run's state."""

from __future__ import annotations

import numpy as np
import torch

from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.run.state import Part
from aerial_il.algorithms.run.train_state import Follower, TrainState, adam
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts.network import StochasticNetwork


class Agent[Network: StochasticNetwork](Part):
    """An actor and action-value critics with slowly following targets; each algorithm's file says what they learn.

    Args:
        settings: of the algorithm. actor: the policy's network. sizes: Do and Da.

    Attributes:
        updates: gradient steps of the critics so far.
    """

    changing = ("actor_state", "critics", "targets", "updates")

    def __init__(self, settings: Algorithm, actor: Network, sizes: tuple[int, int]) -> None:
        self.settings, self.actor, self.sizes, self.updates = settings, actor, sizes, 0
        critics = settings.critics.build(sizes)
        self.actor_state = TrainState(actor, adam(actor, settings.lr))
        self.critics = TrainState(critics, adam(critics, settings.lr))
        self.targets = Follower(critics)

    @torch.no_grad()
    def explore(self, obs: np.ndarray) -> np.ndarray:
        """Return normalised actions (n, Da) to explore with, for encoded observations (n, Do): samples of the actor."""
        return self.actor.sample(tensor(obs)[:, None])[0].numpy()

    def set_lr(self, lr: float) -> None:
        """Take all steps that follow at the learning rate ``lr``."""
        for part in (getattr(self, name) for name in self.changing):
            if isinstance(part, TrainState):
                part.set_lr(lr)
