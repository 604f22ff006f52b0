"""Actions that a policy predicts along a demonstration it has not seen, beside those of the demonstrator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from aerial_il.core.seeding import torch_rng
from aerial_il.data.episode import Episode

if TYPE_CHECKING:
    from aerial_il.policies.parts.chunk_policy import ChunkPolicy


@dataclass(frozen=True, eq=False)
class Prediction:
    """A demonstration of T steps and the chunks predicted from its observations, one after the other.

    Attributes:
        uid: of the demonstration. labels, units: of the action's elements.
        time_s: (T,) since its start. shown: (T, Da) what the demonstrator meant to do.
        predicted: (T, Da) the policy's chunks, each from the observation at its first step, none from its own flight.
        starts: steps at which a chunk begins.
    """

    uid: str
    labels: tuple[str, ...]
    units: tuple[str, ...]
    time_s: np.ndarray
    shown: np.ndarray
    predicted: np.ndarray
    starts: np.ndarray

    @property
    def error(self) -> np.ndarray:
        """(Da,) mean absolute difference, in the action's units."""
        return np.abs(self.predicted - self.shown).mean(axis=0)


def predict(policy: ChunkPolicy, episode: Episode) -> Prediction:
    """Let ``policy`` predict all of ``episode``, chunk by chunk.

    Raises:
        InvalidValueError: the episode comes from another environment than the policy.
    """
    policy.check(episode.spec)
    spec, steps = policy.spec, len(episode)
    frames = policy.interface.layout.flatten(episode.obs)[:steps]
    starts = np.arange(0, steps, policy.config.chunk)
    behind = np.maximum(starts[:, None] + np.arange(1 - policy.config.history, 1), 0)
    with torch_rng(0, "predictions"):
        images = {n: image[:steps][behind] for n, image in policy.interface.layout.look(episode.obs).items()}
        chunks = policy.predict(frames[behind], images=images)
    unasked = np.isnan(episode.expert_actions)
    return Prediction(
        uid=episode.uid,
        labels=spec.action.labels,
        units=spec.action.units,
        time_s=np.arange(steps) * spec.control_dt_s,
        shown=np.where(unasked, episode.executed_actions, episode.expert_actions),
        predicted=chunks.reshape(-1, chunks.shape[-1])[:steps],
        starts=starts,
    )
