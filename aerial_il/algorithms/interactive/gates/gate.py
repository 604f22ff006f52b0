"""The base class of a gate's settings, and the inputs that a gate of one round is built from."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

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


class GateSettings(ABC):
    """Settings of a gate, a frozen dataclass.

    Attributes:
        ensemble: how many policies are trained, whose actions it compares; 1 for the learner alone.
        alone: how many flights the learner makes alone before each round.

    Class attribute: ``of_operator``, whether somebody at the controls may decide in its place.
    """

    of_operator: ClassVar[bool] = False
    ensemble: int = 1
    alone: int = 0

    @abstractmethod
    def open(self, of: Round) -> Gate:
        """Return the gate of one round."""

    def metrics(self, number: int) -> dict[str, float]:
        """Return what there is to log of it in round ``number``."""
        del number
        return {}
