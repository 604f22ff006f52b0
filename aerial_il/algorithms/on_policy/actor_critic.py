"""What learns from rollouts: an actor and the state-value critic that judges its decisions, and their minibatches."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.algorithms.on_policy.advantages import Advantages, Judged
from aerial_il.algorithms.on_policy.settings import Rollout
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.run.state import Part
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts.network import StochasticNetwork


class CriticNetwork(nn.Module):
    """A perceptron with tanh from observations (B, Do) to values (B,)."""

    def __init__(self, inputs: int, hidden: Sequence[int]) -> None:
        super().__init__()
        parts = [part for a, b in pairwise((inputs, *hidden)) for part in (nn.Linear(a, b), nn.Tanh())]
        self.layers = nn.Sequential(*parts, nn.Linear(hidden[-1], 1))

    def forward(self, obs: Tensor) -> Tensor:
        return self.layers(obs)[..., 0]


def minibatches(count: int, batch_size: int | None) -> list[Tensor]:
    """Return rows in random order, in minibatches; a last row left alone, which has no spread, joins others."""
    parts = list(torch.randperm(count).split(batch_size or count))
    if len(parts) > 1 and len(parts[-1]) == 1:
        parts[-2:] = [torch.cat(parts[-2:])]
    return parts


class Critic(TrainState[CriticNetwork]):
    """A state-value critic with its optimiser.

    Args:
        obs_size: Do. hidden: its widths. lr: its learning rate.
    """

    def __init__(self, obs_size: int, hidden: Sequence[int], *, lr: float) -> None:
        network = CriticNetwork(obs_size, hidden)
        super().__init__(network, adam(network, lr))

    @torch.no_grad()
    def values(self, obs: np.ndarray) -> np.ndarray:
        """Return values V(s) (...) of encoded observations (..., Do)."""
        return self.network(tensor(obs)).numpy()

    def loss(self, part: Advantages) -> Tensor:
        """Return the mean squared error."""
        return ((self.network(part.obs) - part.targets) ** 2).mean()

    def fit(self, data: Advantages, rollout: Rollout) -> float:
        """Fit the critic to the targets in several passes; return the mean loss."""
        losses = []
        for _ in range(rollout.epochs):
            for i in minibatches(len(data.obs), rollout.batch_size):
                loss = self.loss(data.rows(i))
                self.descend(loss)
                losses.append(loss.item())
        return float(np.mean(losses))


class ActorCritic[Actor: StochasticNetwork](Part):
    """An actor, whose steps stand in the file of each algorithm, and its critic.

    Args:
        settings: of the algorithm. actor: the policy's network. obs_size: elements that a decision sees.
    """

    changing = ("actor", "_critic")

    def __init__(self, settings: Algorithm, actor: Actor, obs_size: int) -> None:
        self.settings, self.actor = settings, actor
        self._critic = Critic(obs_size, settings.critic_hidden, lr=settings.lr)

    def values(self, obs: np.ndarray) -> np.ndarray:
        """Return the critic's values (...) of what decisions see (..., Do)."""
        return self._critic.values(obs)

    @abstractmethod
    def learn(self, judged: Judged, *, left: float, improve: bool = True) -> Mapping[str, float]:
        """Learn from one rollout's decisions, and return named numbers.

        Args:
            left: share of the training that is left. improve: whether the actor is updated; else the critic alone.
        """
