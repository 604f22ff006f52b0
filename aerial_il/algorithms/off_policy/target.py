"""Target networks, and what ensembles of critics have to be."""

from __future__ import annotations

import copy
from typing import Protocol

import torch
from torch import nn

from aerial_il.algorithms.run.checks import require_positive
from aerial_il.algorithms.run.state import Snapshot
from aerial_il.algorithms.run.train_state import load_weights, weights_of
from aerial_il.core.errors import InvalidValueError


class Target[Network: nn.Module]:
    """A target network: a copy of a network that follows it slowly.

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
        """Move that ``share`` of the way to the network as it is now (Polyak averaging)."""
        for copied, followed in self._pairs:
            copied.lerp_(followed, share)

    def snapshot(self) -> Snapshot:
        return Snapshot(weights_of(self.network))

    def restore(self, saved: Snapshot) -> None:
        load_weights(self.network, saved.arrays)


class Ensemble(Protocol):
    """Settings of an ensemble of critics, of which each backup uses ``subset``."""

    @property
    def critics(self) -> int: ...
    @property
    def subset(self) -> int: ...


def check_ensemble(settings: Ensemble) -> None:
    """Raise :class:`InvalidValueError` unless there are critics, and as many as are to be sampled."""
    require_positive(settings, "critics", "subset")
    if settings.subset > settings.critics:
        raise InvalidValueError(f"subset is {settings.subset}; it must be at most critics, {settings.critics}.")
