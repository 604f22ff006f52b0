"""Demonstrations made ready for one run: windows, normalisers, the order of minibatches, what is held out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from aerial_il.algorithms.supervised.training_set import (
    Demonstrations,
    Shuffle,
    TrainingSet,
    cut_windows,
    digest_of,
    fit_interface,
    window_weights,
)
from aerial_il.core.checkpoint import Checkpoint, digest
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.network import PolicySettings


@dataclass(frozen=True, eq=False)
class Prepared:
    """What a run of supervised learning is given.

    Attributes:
        policy: what is trained. initial: whose weights it starts from, or None.
        layout, interface: the way into and out of its network.
        training: windows to learn from. held_out: windows to validate on, or None.
        order: in which they are visited.
        description: what of the data decides the run.
    """

    policy: PolicySettings
    initial: ChunkPolicy | None
    layout: Layout
    interface: Interface
    training: TrainingSet
    held_out: TrainingSet | None
    order: Shuffle
    description: dict[str, Any]


def prepare(
    demos: Demonstrations,
    policy: PolicySettings,
    *,
    batch_size: int,
    device: str,
    seed: int,
    initial: ChunkPolicy | None,
) -> Prepared:
    """Cut demonstrations into windows and normalise them, as ``initial`` does where it is given.

    Raises:
        InvalidValueError: ``initial`` has another configuration than ``policy``.
    """
    layout = demos.layout
    if initial and (initial.config != policy or initial.interface.layout.names != layout.names):
        raise InvalidValueError("The initial policy has another configuration than the one to train.")
    windows = cut_windows(demos.kept, layout, policy)
    weights = window_weights(demos.weights, windows)
    interface = initial.interface if initial else fit_interface(layout, windows, policy)
    training = TrainingSet(windows, interface, device)
    held_out = TrainingSet(cut_windows(demos.held_out, layout, policy), interface, device) if demos.held_out else None
    order = Shuffle(len(training), batch_size, seed=seed, weights=weights)
    found = len(demos.kept) + len(demos.held_out)
    data = {"demonstrations": found, "frames": len(training), "digest": digest_of(windows, weights)}
    start = {"initial": digest(Checkpoint(initial.to_checkpoint().arrays))} if initial else {}
    return Prepared(policy, initial, layout, interface, training, held_out, order, {"dataset": data, **start})
