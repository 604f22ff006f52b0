"""A state-value critic, whose estimate is the baseline of policy gradients, and the minibatches that it learns from."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.algorithms.on_policy.advantages import Advantages
from aerial_il.algorithms.on_policy.settings import Rollout
from aerial_il.algorithms.run.state import Snapshot
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.core.tensors import tensor


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


class Critic:
    """A state-value critic with its optimiser.

    Args:
        obs_size: Do. hidden: its widths. lr: its learning rate.
    """

    def __init__(self, obs_size: int, hidden: Sequence[int], *, lr: float) -> None:
        network = CriticNetwork(obs_size, hidden)
        self._trained = TrainState(network, adam(network, lr))

    def set_lr(self, lr: float) -> None:
        """Take all steps that follow at the learning rate ``lr``."""
        self._trained.set_lr(lr)

    @torch.no_grad()
    def values(self, obs: np.ndarray) -> np.ndarray:
        """Return values V(s) (...) of encoded observations (..., Do)."""
        return self._trained.network(tensor(obs)).numpy()

    def loss(self, part: Advantages) -> Tensor:
        """Return the mean squared error."""
        return ((self._trained.network(part.obs) - part.targets) ** 2).mean()

    def descend(self, loss: Tensor, *, clip_norm: float | None = None) -> None:
        """Take one step against the gradient of ``loss``."""
        self._trained.descend(loss, clip_norm=clip_norm)

    def fit(self, data: Advantages, rollout: Rollout) -> float:
        """Fit the critic to the targets in several passes; return the mean loss."""
        losses = []
        for _ in range(rollout.epochs):
            for i in minibatches(len(data.obs), rollout.batch_size):
                loss = self.loss(data.rows(i))
                self.descend(loss)
                losses.append(loss.item())
        return float(np.mean(losses))

    def snapshot(self) -> Snapshot:
        return self._trained.snapshot()

    def restore(self, saved: Snapshot) -> None:
        self._trained.restore(saved)
