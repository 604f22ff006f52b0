"""A network in training with its optimiser, as one part of a run's state."""

import copy
from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.algorithms.run.state import Snapshot, load_weights, weights_of
from aerial_il.policies.parts.prefixed import below, under


class TrainState[Network: nn.Module]:
    """A network and its optimiser.

    Args:
        network: what is trained.
        optimizer: over its parameters.
    """

    def __init__(self, network: Network, optimizer: torch.optim.Optimizer) -> None:
        self.network, self.optimizer = network, optimizer
        self._weights = [weight for weight in network.parameters() if weight.requires_grad]

    def set_lr(self, lr: float) -> None:
        """Take all steps that follow at the learning rate ``lr``."""
        for group in self.optimizer.param_groups:
            group["lr"] = lr

    def descend(self, loss: Tensor, clip_norm: float | None = None) -> None:
        """Take one step against the gradient of ``loss``, which reaches this network alone."""
        self.backward(loss, clip_norm)
        self.optimizer.step()

    def backward(self, loss: Tensor, clip_norm: float | None = None) -> float | None:
        """Compute the gradient of ``loss`` and return its norm before it was clipped, where it was."""
        for weight in self._weights:
            weight.grad = None
        loss.backward(inputs=self._weights)
        return None if clip_norm is None else nn.utils.clip_grad_norm_(self._weights, clip_norm).item()

    def snapshot(self) -> Snapshot:
        return Snapshot({**under("network", weights_of(self.network)), **under("optimizer", to_arrays(self.optimizer))})

    def restore(self, saved: Snapshot) -> None:
        load_weights(self.network, below("network", saved.arrays))
        from_arrays(self.optimizer, below("optimizer", saved.arrays))


class Follower[Network: nn.Module]:
    """A copy of a network that follows it slowly: a target network, or the average of its weights.

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


def adam(network: nn.Module, lr: float) -> torch.optim.Adam:
    """Return Adam over ``network``, its step compiled into one loop over all weights."""
    return torch.optim.Adam(network.parameters(), lr=lr, fused=True)


def adamw(network: nn.Module, *, weight_decay: float) -> torch.optim.AdamW:
    """Return AdamW over ``network``, decaying matrices only: biases and gains need no pull to zero."""
    matrices = [p for p in network.parameters() if p.ndim > 1]
    vectors = [p for p in network.parameters() if p.ndim <= 1]
    groups = [{"params": matrices, "weight_decay": weight_decay}, {"params": vectors, "weight_decay": 0.0}]
    return torch.optim.AdamW(groups, fused=True)


def to_arrays(optimizer: torch.optim.Optimizer) -> dict[str, np.ndarray]:
    """Return the optimiser's moments and counters as ``index.name -> array``."""
    state = optimizer.state_dict()["state"]
    return {f"{i}.{key}": value.cpu().numpy() for i, entry in state.items() for key, value in entry.items()}


def from_arrays(optimizer: torch.optim.Optimizer, arrays: Mapping[str, np.ndarray]) -> None:
    """Restore :func:`to_arrays`'s result into a fresh optimiser over the same parameters."""
    state: dict[int, dict[str, Tensor]] = {}
    for name, value in arrays.items():
        index, _, key = name.partition(".")
        state.setdefault(int(index), {})[key] = torch.from_numpy(value.copy())
    optimizer.load_state_dict({**optimizer.state_dict(), "state": state})
