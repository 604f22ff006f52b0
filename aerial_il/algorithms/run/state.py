"""State of a run in training: its parts as arrays and plain values in one checkpoint, restored bit for bit."""

from collections.abc import Mapping
from copy import deepcopy
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np
import torch
from torch import nn

from aerial_il.core.checkpoint import Checkpoint
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.prefixed import below, under

PARTS = "parts"
GENERATOR, CUDA_GENERATOR = "torch.generator", "torch.cuda_generator"


class Snapshot(NamedTuple):
    """One part at one moment: arrays, and plain values that JSON keeps."""

    arrays: Mapping[str, np.ndarray]
    values: Mapping[str, Any] = {}


@runtime_checkable
class Stateful(Protocol):
    """Anything whose state decides how a run goes on."""

    def snapshot(self) -> Snapshot:
        """Return copies of all that changes while the run goes on."""
        ...

    def restore(self, saved: Snapshot) -> None:
        """Go back to the moment at which ``saved`` was taken."""
        ...


@runtime_checkable
class Remembering(Protocol):
    """What flies n worlds and remembers something of each, such as a policy."""

    def memory(self) -> dict[str, np.ndarray]: ...
    def recall(self, memory: Mapping[str, np.ndarray]) -> None: ...


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


class Part:
    """A part of a run whose state is that of some of its attributes.

    Class attribute ``changing``: which ones; they are kept by their names without a leading underscore. They may be
    arrays, mappings of arrays, networks, generators, what has a ``memory``, other parts, or plain values.
    """

    changing: ClassVar[tuple[str, ...]] = ()

    def snapshot(self) -> Snapshot:
        arrays, values = dict[str, np.ndarray](), dict[str, Any]()
        for key, value in ((name.lstrip("_"), getattr(self, name)) for name in self.changing):
            match value:
                case np.ndarray():
                    arrays[key] = value.copy()
                case np.random.Generator():
                    values[key] = value.bit_generator.state
                case nn.Module():
                    arrays |= under(key, weights_of(value))
                case Remembering():
                    arrays |= under(key, value.memory())
                case Stateful():
                    inner = value.snapshot()
                    arrays |= under(key, inner.arrays)
                    values |= {key: dict(inner.values)} if inner.values else {}
                case _:
                    values[key] = deepcopy(value)
        return Snapshot(arrays, values)

    def restore(self, saved: Snapshot) -> None:
        for name in self.changing:
            key, value = name.lstrip("_"), getattr(self, name)
            match value:
                case np.ndarray():
                    setattr(self, name, saved.arrays[key].copy())
                case np.random.Generator():
                    value.bit_generator.state = saved.values[key]
                case nn.Module():
                    load_weights(value, below(key, saved.arrays))
                case Remembering():
                    value.recall(below(key, saved.arrays))
                case Stateful():
                    value.restore(Snapshot(below(key, saved.arrays), saved.values.get(key, {})))
                case _:
                    setattr(self, name, deepcopy(saved.values[key]))


def weights_of(network: nn.Module) -> dict[str, np.ndarray]:
    """Return copies of a network's weights and buffers as arrays."""
    return {name: value.detach().cpu().numpy().copy() for name, value in network.state_dict().items()}


def load_weights(network: nn.Module, arrays: Mapping[str, np.ndarray]) -> None:
    """Put :func:`weights_of`'s result into a network."""
    network.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in arrays.items()})
