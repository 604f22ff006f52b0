"""Behavioural cloning as a place to begin reinforcement learning from."""

from __future__ import annotations

from torch import Tensor

from aerial_il.algorithms.rl.replay_buffer import Batch, Replay
from aerial_il.algorithms.run.state import Trained
from aerial_il.policies.squashed_gaussian import SquashedGaussian


def clone(part: Trained, actor: SquashedGaussian, shown: Replay, *, steps: int, batch_size: int) -> None:
    """Move the centre of ``actor`` towards demonstrated actions in ``steps`` minibatches of ``part``'s optimiser."""
    for _ in range(steps):
        part.descend(away_from(actor, shown.sample(batch_size)))


def away_from(actor: SquashedGaussian, shown: Batch) -> Tensor:
    """Return how far the actor's centre is from demonstrated actions, squared and summed over elements."""
    away = ((actor(shown.obs[:, None, :-1])[:, 0] - shown.actions) ** 2).sum(1)
    return ((1.0 - shown.obs[:, -1]) * away).mean()
