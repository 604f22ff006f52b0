"""Pieces of a training step: parameter groups, learning-rate schedule, averaged weights, optimiser state as arrays."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping

import numpy as np
import torch
from torch import nn


def adamw(network: nn.Module, *, weight_decay: float) -> torch.optim.AdamW:
    """Return AdamW over ``network``, decaying matrices only: biases and gains need no pull to zero."""
    matrices = [p for p in network.parameters() if p.ndim > 1]
    vectors = [p for p in network.parameters() if p.ndim <= 1]
    groups = [{"params": matrices, "weight_decay": weight_decay}, {"params": vectors, "weight_decay": 0.0}]
    return torch.optim.AdamW(groups, fused=True)


def cosine(progress: float, step: int, *, warmup_steps: int, floor: float) -> float:
    """Return the factor of the peak learning rate: a linear warm-up, then half a cosine wave down to ``floor``.

    Args:
        progress: share of the training that is done, in [0, 1].
        step: steps done.
        warmup_steps: length of the warm-up.
        floor: factor at the end.
    """
    warm = min(1.0, (step + 1) / max(1, warmup_steps))
    return warm * (floor + (1 - floor) * 0.5 * (1 + math.cos(math.pi * min(1.0, progress))))


class Ema[Network: nn.Module]:
    """An exponential moving average of a network's weights.

    Early on the average follows faster, ``min(decay, (1 + step) / (10 + step))``, to forget the random start.

    Attributes:
        network: a copy whose weights are the average.
    """

    def __init__(self, network: Network, decay: float) -> None:
        self.decay = decay
        self.network: Network = copy.deepcopy(network).requires_grad_(False).eval()
        self._pairs = list(zip(self.network.parameters(), network.parameters(), strict=True))

    @torch.no_grad()
    def update(self, step: int) -> None:
        """Move the average towards the current weights after optimisation step ``step``."""
        decay = min(self.decay, (1 + step) / (10 + step))
        for average, current in self._pairs:
            average.lerp_(current, 1 - decay)


def to_arrays(optimizer: torch.optim.Optimizer) -> dict[str, np.ndarray]:
    """Return the optimiser's moments and counters as ``index.name -> array``."""
    state = optimizer.state_dict()["state"]
    return {f"{i}.{key}": value.cpu().numpy() for i, entry in state.items() for key, value in entry.items()}


def from_arrays(optimizer: torch.optim.Optimizer, arrays: Mapping[str, np.ndarray]) -> None:
    """Restore :func:`to_arrays`'s result into a fresh optimiser over the same parameters."""
    state: dict[int, dict[str, torch.Tensor]] = {}
    for name, value in arrays.items():
        index, _, key = name.partition(".")
        state.setdefault(int(index), {})[key] = torch.from_numpy(value.copy())
    optimizer.load_state_dict({**optimizer.state_dict(), "state": state})
