"""The base class of a gate's settings, and the inputs that a gate of one round is built from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from aerial_il.algorithms.interactive.mixture import Gate
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy


@dataclass(frozen=True)
class Round:
    """What a gate may be made from.

    Attributes:
        number: of the round, from 1; 0 is the first training on demonstrations.
        seed: of the run.
        members: the learner first, then the others of its ensemble.
        dataset: labelled episodes that they were trained on.
        probes: flights of learners alone, of this round and those before.
    """

    number: int
    seed: int
    members: Sequence[ChunkPolicy]
    dataset: Sequence[Episode]
    probes: Sequence[Episode]


class GateSettings(Protocol):
    """Settings of a gate, a frozen dataclass."""

    @property
    def ensemble(self) -> int:
        """How many policies are trained, whose actions it compares; 1 for the learner alone."""
        ...

    @property
    def alone(self) -> int:
        """How many flights the learner makes alone before each round."""
        ...

    def open(self, of: Round) -> Gate:
        """Return the gate of one round."""
        ...
