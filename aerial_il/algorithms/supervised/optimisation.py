"""Learning-rate schedule and averaged weights of supervised learning."""

from __future__ import annotations

import copy
import math

import torch
from torch import nn


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
