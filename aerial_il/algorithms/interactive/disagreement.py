"""Distance between actions, in units in which every element counts alike, and disagreement of an ensemble."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy


@dataclass(frozen=True, eq=False)
class ActionScale:
    """The spread of demonstrated actions, element by element.

    Attributes:
        sizes: (Da,) in the action's units.
    """

    sizes: np.ndarray

    @staticmethod
    def of(policy: ChunkPolicy) -> ActionScale:
        """Return the scale that ``policy`` normalises actions with: anchored ones count as offsets."""
        return ActionScale(policy.interface.action.scale.astype(float))

    def distance(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Root mean square (N,) over the elements of the scaled difference of actions (N, Da)."""
        return np.sqrt((((one - other) / self.sizes) ** 2).mean(axis=1))


def disagreement(actions: np.ndarray, scale: ActionScale) -> np.ndarray:
    """Variance over the K policies of their actions (K, N, Da), scaled, mean over the elements (N,)."""
    return (actions / scale.sizes).var(axis=0).mean(axis=1)


def actions_along(policy: ChunkPolicy, episodes: Sequence[Episode]) -> np.ndarray:
    """Return what ``policy`` would have done (N, Da) at each step of the episodes, one after the other.

    It is shown each flight from its start, as if it flew, and keeps its state accordingly.
    """
    lengths = np.array([len(episode) for episode in episodes])
    names = (*policy.interface.layout.names, *policy.config.images)
    policy.reset()
    answers = []
    for step in range(lengths.max()):
        rows = np.minimum(step, lengths - 1)
        obs = {name: np.stack([e.obs[name][row] for e, row in zip(episodes, rows, strict=True)]) for name in names}
        answers.append(policy.act(obs))
    policy.reset()
    table = np.stack(answers, axis=1)  # (episodes, T, Da)
    return np.concatenate([row[:length] for row, length in zip(table, lengths, strict=True)])
