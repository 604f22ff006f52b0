"""Critics of actions, several at once, and the targets that follow networks slowly."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

import torch
from torch import Tensor, nn
from torch.nn import functional

from aerial_il.algorithms.run.checks import require_positive
from aerial_il.algorithms.run.state import Snapshot
from aerial_il.algorithms.run.train_state import load_weights, weights_of
from aerial_il.core.errors import InvalidValueError


class Critics(nn.Module):
    """Perceptrons side by side, each layer one multiplication: (B, Do + 1), (B, Da) -> (count, B).

    Args:
        inputs: Do + 1 + Da. hidden: widths. count: how many there are.
        layer_norm: standardise each hidden layer before its ReLU, which bounds what is claimed far from all data.
    """

    def __init__(self, inputs: int, hidden: Sequence[int], count: int = 2, *, layer_norm: bool = False) -> None:
        super().__init__()
        self.count, self.weights, self.biases = count, nn.ParameterList(), nn.ParameterList()
        normed = hidden if layer_norm else ()
        self.gains = nn.ParameterList(nn.Parameter(torch.ones(count, 1, width)) for width in normed)
        self.shifts = nn.ParameterList(nn.Parameter(torch.zeros(count, 1, width)) for width in normed)
        for a, b in pairwise((inputs, *hidden, 1)):
            bound = 1.0 / math.sqrt(a)
            self.weights.append(nn.Parameter(torch.empty(count, a, b).uniform_(-bound, bound)))
            self.biases.append(nn.Parameter(torch.empty(count, 1, b).uniform_(-bound, bound)))

    def forward(self, obs: Tensor, actions: Tensor, chosen: Tensor | None = None) -> Tensor:
        """Return the values of all critics, or of the ``chosen`` ones (Z,) alone, (Z, B)."""
        every = (self.weights, self.biases, self.gains, self.shifts)
        weights, biases, gains, shifts = ([p if chosen is None else p[chosen] for p in group] for group in every)
        x = torch.cat([obs, actions], dim=-1).expand(len(weights[0]), -1, -1)
        for layer, (weight, bias) in enumerate(zip(weights[:-1], biases[:-1], strict=True)):
            x = torch.baddbmm(bias, x, weight)
            if gains:
                x = functional.layer_norm(x, x.shape[-1:]) * gains[layer] + shifts[layer]
            x = torch.relu(x)
        return torch.baddbmm(biases[-1], x, weights[-1])[..., 0]


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


class Ensemble(Protocol):
    """Settings of an ensemble of critics, ``subset`` of which each backup believes."""

    @property
    def critics(self) -> int: ...
    @property
    def subset(self) -> int: ...


def check_ensemble(settings: Ensemble) -> None:
    """Raise :class:`InvalidValueError` unless there are critics, and as many as are to be drawn."""
    require_positive(settings, "critics", "subset")
    if settings.subset > settings.critics:
        raise InvalidValueError(f"subset is {settings.subset}; it must be at most critics, {settings.critics}.")
