"""Off-policy agents: their networks in training, and what several of them learn."""

import numpy as np
import torch
from torch import Tensor

from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.replay_buffer import Batch
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.run.state import Part
from aerial_il.algorithms.run.train_state import Follower, TrainState, adam
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts.critics import Critics
from aerial_il.policies.parts.network import StochasticNetwork
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork, unsquashed


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


def squared_error(
    critics: Critics, batch: Batch, targets: Tensor, *, spread: bool = False
) -> tuple[Tensor, dict[str, float]]:
    """Return ``mean (Q(s, a) - y)^2``, summed over the critics, for ``targets`` y (B,); and named numbers.

    Args:
        spread: whether the standard deviation over the critics is among them.
    """
    values = critics(batch.obs, batch.actions)
    loss = ((values - targets) ** 2).mean(1).sum()
    means = {"critic/loss": loss.item(), "critic/value": values.mean().item()}
    if spread:
        means["critic/spread"] = values.detach().std(0, correction=0).mean().item()
    return loss, means


def ascent(actor: SquashedGaussianNetwork, critics: Critics, batch: Batch, smoothness: Smoothness) -> Tensor:
    """Return ``-mean Q1(s, mu(s))`` of a deterministic actor mu and the first critic, plus the smoothness loss."""
    obs = batch.obs[:, :-1]
    values = critics(batch.obs, actor(obs[:, None])[:, 0])[0]
    return -values.mean() + smoothness.loss(actor, obs, batch.next_obs[:, :-1])


def weighted_likelihood(
    actor: SquashedGaussianNetwork, batch: Batch, weights: Tensor, advantages: Tensor
) -> tuple[Tensor, dict[str, float]]:
    """Return ``-mean w log pi(a | s)`` without the absorbing state, where no action is chosen; and named numbers.

    Args:
        weights, advantages: (B,) of the actions.
    """
    alive = 1.0 - batch.obs[:, -1]
    share = alive / alive.sum().clamp(min=1.0)
    log_prob, _ = actor.judge(batch.obs[:, None, :-1], unsquashed(batch.actions))
    loss = -(share * weights * log_prob).sum()
    means = {"actor/advantage": (share * advantages).sum().item(), "actor/weight": (share * weights).sum().item()}
    return loss, {"actor/loss": loss.item(), **means}
