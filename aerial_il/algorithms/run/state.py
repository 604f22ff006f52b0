"""What a run is made of, put into a checkpoint part by part and taken out again bit for bit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
import torch
from torch import nn

from aerial_il.algorithms.supervised.optimisation import from_arrays, to_arrays
from aerial_il.core.checkpoint import Checkpoint
from aerial_il.policies.parts.chunk_policy import ChunkPolicy

PREFIX = "parts"


class Snapshot(NamedTuple):
    """One part at one moment: arrays, and plain values that JSON keeps."""

    arrays: Mapping[str, np.ndarray]
    values: Mapping[str, Any] = {}


class Part(Protocol):
    """Anything whose state decides how a run goes on."""

    def snapshot(self) -> Snapshot:
        """Return copies of all that changes while the run goes on."""
        ...

    def restore(self, saved: Snapshot) -> None:
        """Go back to the moment at which ``saved`` was taken."""
        ...


def pack(parts: Mapping[str, Part], flying: ChunkPolicy) -> Checkpoint:
    """Return a checkpoint that holds all ``parts``, torch's generator and a policy that can fly by itself."""
    policy = flying.to_checkpoint()
    taken = {name: part.snapshot() for name, part in parts.items()}
    arrays = {f"{PREFIX}.{name}.{key}": array for name, one in taken.items() for key, array in one.arrays.items()}
    arrays["torch.generator"] = torch.get_rng_state().numpy()
    values = {name: dict(one.values) for name, one in taken.items()}
    return Checkpoint({**policy.arrays, **arrays}, {**policy.state, PREFIX: values}, policy.config)


def unpack(saved: Checkpoint, parts: Mapping[str, Part]) -> None:
    """Restore ``parts`` and torch's generator from what :func:`pack` made."""
    for name, part in parts.items():
        arrays = below(f"{PREFIX}.{name}.", saved.arrays)
        part.restore(Snapshot(arrays, saved.state[PREFIX][name]))
    torch.set_rng_state(torch.from_numpy(saved.arrays["torch.generator"].copy()))


def below(prefix: str, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the arrays whose names begin with ``prefix``, without it."""
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}


class Generator:
    """A numpy generator as a part of a run."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng

    def snapshot(self) -> Snapshot:
        return Snapshot({}, {"state": self.rng.bit_generator.state})

    def restore(self, saved: Snapshot) -> None:
        self.rng.bit_generator.state = saved.values["state"]


class Trained:
    """A network and its optimiser as a part of a run."""

    def __init__(self, network: nn.Module, optimizer: torch.optim.Optimizer) -> None:
        self.network, self.optimizer = network, optimizer
        self._weights = list(network.parameters())

    def learn_at(self, lr: float) -> None:
        """Let all steps that follow be taken at the learning rate ``lr``."""
        for group in self.optimizer.param_groups:
            group["lr"] = lr

    def descend(self, loss: torch.Tensor, clip_norm: float | None = None) -> None:
        """Take one step against the gradient of ``loss``, which reaches this network alone."""
        for weight in self._weights:
            weight.grad = None
        loss.backward(inputs=self._weights)
        if clip_norm is not None:
            nn.utils.clip_grad_norm_(self._weights, clip_norm)
        self.optimizer.step()

    def snapshot(self) -> Snapshot:
        weights = {f"network.{name}": value.detach().cpu().numpy() for name, value in self.network.state_dict().items()}
        moments = {f"optimizer.{name}": value for name, value in to_arrays(self.optimizer).items()}
        return Snapshot({**weights, **moments})

    def restore(self, saved: Snapshot) -> None:
        weights = {name: torch.from_numpy(value.copy()) for name, value in below("network.", saved.arrays).items()}
        self.network.load_state_dict(weights)
        from_arrays(self.optimizer, below("optimizer.", saved.arrays))


def adam(network: nn.Module, lr: float) -> torch.optim.Adam:
    """Return Adam over ``network``, its step compiled into one loop over all weights."""
    return torch.optim.Adam(network.parameters(), lr=lr, fused=True)
