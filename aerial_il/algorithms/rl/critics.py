"""Critics of actions, several at once, and the targets that follow networks slowly."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

from aerial_il.algorithms.run.state import Snapshot
from aerial_il.algorithms.run.train_state import load_weights, weights_of


class Critics(nn.Module):
    """Perceptrons side by side, each layer one multiplication: (B, Do + 1), (B, Da) -> (count, B)."""

    def __init__(self, inputs: int, hidden: Sequence[int], count: int = 2) -> None:
        super().__init__()
        self.count, self.weights, self.biases = count, nn.ParameterList(), nn.ParameterList()
        for a, b in pairwise((inputs, *hidden, 1)):
            bound = 1.0 / math.sqrt(a)
            self.weights.append(nn.Parameter(torch.empty(count, a, b).uniform_(-bound, bound)))
            self.biases.append(nn.Parameter(torch.empty(count, 1, b).uniform_(-bound, bound)))

    def forward(self, obs: Tensor, actions: Tensor) -> Tensor:
        x = torch.cat([obs, actions], dim=-1).expand(self.count, -1, -1)
        *hidden, last = zip(self.weights, self.biases, strict=True)
        for weight, bias in hidden:
            x = torch.relu(torch.baddbmm(bias, x, weight))
        return torch.baddbmm(last[1], x, last[0])[..., 0]


class Target[Network: nn.Module]:
    """A copy of a network that follows it slowly.

    Args:
        network: what is followed.

    Attributes:
        network: the copy.
    """

    def __init__(self, network: Network) -> None:
        self.network = copy.deepcopy(network).requires_grad_(False)
        self._pairs = list(zip(self.network.parameters(), network.parameters(), strict=True))

    @torch.no_grad()
    def follow(self, share: float) -> None:
        """Go that ``share`` of the way to the network as it is now."""
        for copied, followed in self._pairs:
            copied.lerp_(followed, share)

    def snapshot(self) -> Snapshot:
        return Snapshot(weights_of(self.network))

    def restore(self, saved: Snapshot) -> None:
        load_weights(self.network, saved.arrays)
