"""Behavioural cloning before and beside reinforcement learning."""

from __future__ import annotations

from torch import Tensor, nn

from aerial_il.algorithms.online.replay_buffer import Batch, ReplayBuffer
from aerial_il.algorithms.run.train_state import TrainState
from aerial_il.policies.parts.network import ChunkNetwork


def bc_pretrain[Network: nn.Module](
    trained: TrainState[Network], actor: ChunkNetwork, demos: ReplayBuffer, *, steps: int, batch_size: int
) -> None:
    """Move ``actor``'s mean action towards demonstrated ones in ``steps`` minibatches of ``trained``'s optimiser."""
    for _ in range(steps):
        trained.descend(bc_loss(actor, demos.sample(batch_size)))


def bc_loss(actor: ChunkNetwork, demos: Batch) -> Tensor:
    """Return the squared distance of the actor's mean action from demonstrated actions, summed over elements."""
    distance = ((actor(demos.obs[:, None, :-1])[:, 0] - demos.actions) ** 2).sum(1)
    return ((1.0 - demos.obs[:, -1]) * distance).mean()
