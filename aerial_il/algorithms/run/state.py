"""State of a run in training: its parts as arrays and plain values in one checkpoint, restored bit for bit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
import torch

from aerial_il.core.checkpoint import Checkpoint
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.prefixed import below, under

PARTS = "parts"
GENERATOR, CUDA_GENERATOR = "torch.generator", "torch.cuda_generator"


class Snapshot(NamedTuple):
    """One part at one moment: arrays, and plain values that JSON keeps."""

    arrays: Mapping[str, np.ndarray]
    values: Mapping[str, Any] = {}


class Stateful(Protocol):
    """Anything whose state decides how a run goes on."""

    def snapshot(self) -> Snapshot:
        """Return copies of all that changes while the run goes on."""
        ...

    def restore(self, saved: Snapshot) -> None:
        """Go back to the moment at which ``saved`` was taken."""
        ...


def pack(parts: Mapping[str, Stateful], policy: ChunkPolicy) -> Checkpoint:
    """Return a checkpoint of all ``parts``, torch's generators, and ``policy``, which alone is enough to act."""
    acting, taken = policy.to_checkpoint(), joined(parts)
    arrays = under(PARTS, taken.arrays)
    arrays[GENERATOR] = torch.get_rng_state().numpy()
    if torch.cuda.is_available() and torch.cuda.is_initialized():
        arrays[CUDA_GENERATOR] = torch.cuda.get_rng_state().numpy()
    return Checkpoint({**acting.arrays, **arrays}, {**acting.state, PARTS: taken.values}, acting.config)


def unpack(saved: Checkpoint, parts: Mapping[str, Stateful]) -> None:
    """Restore ``parts`` and torch's generators from what :func:`pack` made."""
    separate(Snapshot(below(PARTS, saved.arrays), saved.state[PARTS]), parts)
    torch.set_rng_state(torch.from_numpy(saved.arrays[GENERATOR].copy()))
    if CUDA_GENERATOR in saved.arrays:
        torch.cuda.set_rng_state(torch.from_numpy(saved.arrays[CUDA_GENERATOR].copy()))


def joined(parts: Mapping[str, Stateful]) -> Snapshot:
    """Return one snapshot of several parts: arrays under ``part.name``, values under ``part``."""
    taken = {name: part.snapshot() for name, part in parts.items()}
    arrays = {f"{name}.{key}": array for name, one in taken.items() for key, array in one.arrays.items()}
    return Snapshot(arrays, {name: dict(one.values) for name, one in taken.items()})


def separate(saved: Snapshot, parts: Mapping[str, Stateful]) -> None:
    """Restore several parts from what :func:`joined` made of them."""
    for name, part in parts.items():
        part.restore(Snapshot(below(name, saved.arrays), saved.values.get(name, {})))


class Generator:
    """A numpy generator as a part of a run."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng

    def snapshot(self) -> Snapshot:
        return Snapshot({}, {"state": self.rng.bit_generator.state})

    def restore(self, saved: Snapshot) -> None:
        self.rng.bit_generator.state = saved.values["state"]
