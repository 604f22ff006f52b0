"""A state-value critic, whose estimate is the baseline of policy gradients, and the minibatches that it learns from."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.algorithms.rl.on_policy import Rollout
from aerial_il.algorithms.rl.returns import gae
from aerial_il.algorithms.run.state import Snapshot
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.core.tensors import tensor


class Critic(nn.Module):
    """A perceptron with tanh from observations (B, Do) to values (B,)."""

    def __init__(self, inputs: int, hidden: Sequence[int]) -> None:
        super().__init__()
        parts = [part for a, b in pairwise((inputs, *hidden)) for part in (nn.Linear(a, b), nn.Tanh())]
        self.layers = nn.Sequential(*parts, nn.Linear(hidden[-1], 1))

    def forward(self, obs: Tensor) -> Tensor:
        return self.layers(obs)[..., 0]


def minibatches(count: int, batch_size: int) -> list[Tensor]:
    """Return rows in random order, in minibatches; a last row left alone, which has no spread, joins others."""
    parts = list(torch.randperm(count).split(batch_size))
    if len(parts) > 1 and len(parts[-1]) == 1:
        parts[-2:] = [torch.cat(parts[-2:])]
    return parts


class Estimated(NamedTuple):
    """A rollout's T * n steps: obs (·, Do), advantages (·,), the critic's targets (·,), and its mean value."""

    obs: Tensor
    advantages: Tensor
    targets: Tensor
    value: float


class Baseline:
    """A state-value critic with its optimiser: it estimates the advantages of a rollout, and learns from it.

    Args:
        obs_size: Do. hidden: its widths. lr: its learning rate.
    """

    def __init__(self, obs_size: int, hidden: Sequence[int], *, lr: float) -> None:
        critic = Critic(obs_size, hidden)
        self._trained = TrainState(critic, adam(critic, lr))

    def set_lr(self, lr: float) -> None:
        """Take all steps that follow at the learning rate ``lr``."""
        self._trained.set_lr(lr)

    @torch.no_grad()
    def values(self, obs: np.ndarray) -> np.ndarray:
        """Return values V(s) (...) of encoded observations (..., Do)."""
        return self._trained.network(tensor(obs)).numpy()

    def advantages(self, rollout: Rollout, rewards: np.ndarray, *, gamma: float, gae_lambda: float) -> Estimated:
        """Return generalised advantage estimates for ``rewards`` (T, n); the value after a terminal step is zero."""
        values = self.values(rollout.obs)
        after = np.where(rollout.terminal, 0.0, self.values(rollout.next_obs))
        found = gae(rewards, values, after, rollout.ended, gamma=gamma, gae_lambda=gae_lambda)
        arrays = (rollout.flat("obs"), found.ravel(), (found + values).ravel())
        obs, advantages, targets = (tensor(np.asarray(array, np.float32)) for array in arrays)
        return Estimated(obs, advantages, targets, float(values.mean()))

    def fit(self, found: Estimated, *, epochs: int, batch_size: int) -> float:
        """Fit the critic to the targets in several passes; return the mean loss."""
        losses = []
        for _ in range(epochs):
            for i in minibatches(len(found.obs), batch_size):
                loss = ((self._trained.network(found.obs[i]) - found.targets[i]) ** 2).mean()
                self._trained.descend(loss)
                losses.append(loss.item())
        return float(np.mean(losses))

    def snapshot(self) -> Snapshot:
        return self._trained.snapshot()

    def restore(self, saved: Snapshot) -> None:
        self._trained.restore(saved)
