"""A critic of states, whose estimate is the baseline of policy gradients, and the minibatches that it learns from."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn


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
