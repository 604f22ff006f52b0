"""Action-value critics, several at once: of reinforcement learning, and of policies that choose between actions."""

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional


class Critics(nn.Module):
    """Perceptrons side by side, each layer one multiplication: (B, Do + 1), (B, Da) -> (count, B).

    Args:
        inputs: Do + 1 + Da. hidden: widths. count: how many there are.
        layer_norm: standardise each hidden layer before its ReLU, which bounds the estimates far from all data.
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
