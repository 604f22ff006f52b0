"""The gate of HG-DAgger: a supervisor takes over when it sees fit and hands back.

Source: M. Kelly et al., "HG-DAgger: interactive imitation learning with human experts", ICRA 2019: algorithm 1.
"""

from dataclasses import dataclass, field
from typing import ClassVar, Protocol

import numpy as np

from aerial_il.algorithms.interactive.disagreement import ActionScale
from aerial_il.algorithms.interactive.gates.gate import GateSettings, Round
from aerial_il.algorithms.interactive.mixture import Decision, Gate, GateInput
from aerial_il.core.contracts import Observation
from aerial_il.core.errors import InvalidValueError


class Supervisor(Protocol):
    """Decides when the expert flies; a person does so by holding a button."""

    def reset(self, mask: np.ndarray) -> None:
        """Start new flights in the worlds of ``mask`` (n,) bool."""
        ...

    def holds(self, obs: Observation, distance: np.ndarray, flew: np.ndarray) -> np.ndarray:
        """Return in which worlds (n,) bool the expert flies now.

        Args:
            obs: ``name -> (n, ...)``.
            distance: (n,) how far the learner's action is from the expert's, in spreads of demonstrated actions.
            flew: (n,) bool, the expert flew in the step before.
        """
        ...


@dataclass(kw_only=True)
class Corrector:
    """A scripted supervisor: it lets small errors pass, reacts late to large ones, and stays until things are well.

    Attributes:
        take: distance above which it worries.
        give: distance below which it is content.
        patience: steps of worry in a row before it takes over: a person's reaction time.
        least: contented steps in a row before it hands back.
    """

    take: float = 0.5
    give: float = 0.25
    patience: int = 15
    least: int = 15

    def __post_init__(self) -> None:
        if not 0 < self.give <= self.take:
            raise InvalidValueError(f"give is {self.give} and take {self.take}; 0 < give <= take is needed.")
        if self.patience < 1 or self.least < 1:
            raise InvalidValueError(f"patience is {self.patience} and least {self.least}; both start at 1.")
        self._count = np.zeros(0, int)

    def reset(self, mask: np.ndarray) -> None:
        self._count = np.where(mask, 0, self._count) if len(self._count) == len(mask) else np.zeros(len(mask), int)

    def holds(self, obs: Observation, distance: np.ndarray, flew: np.ndarray) -> np.ndarray:
        telling = np.where(flew, distance < self.give, distance > self.take)  # what speaks for a change
        self._count = np.where(telling, self._count + 1, 0)
        change = self._count >= np.where(flew, self.least, self.patience)
        self._count[change] = 0
        return flew ^ change


@dataclass(frozen=True, kw_only=True)
class HumanGate(GateSettings):
    """HG-DAgger: a supervisor takes over when it sees fit and hands back; only what the expert flew is learned.

    Attributes:
        supervisor: who decides: a person, or a script in their place.
    """

    of_operator: ClassVar[bool] = True

    supervisor: Supervisor = field(default_factory=Corrector)

    def open(self, of: Round) -> Gate:
        return _Supervised(self.supervisor, ActionScale.of(of.members[0]))


class _Supervised:
    """Does what the supervisor says."""

    def __init__(self, supervisor: Supervisor, scale: ActionScale) -> None:
        self._supervisor, self._scale = supervisor, scale

    def begin(self, seeds: np.ndarray, mask: np.ndarray) -> None:
        self._supervisor.reset(mask)

    def decide(self, given: GateInput) -> Decision:
        """A supervisor watches all the time, as a person does; only what it flies is asked for."""
        distance = self._scale.distance(given.learner_action, given.expert_action)
        flies = np.asarray(self._supervisor.holds(given.obs, distance, given.expert_flew), bool)
        return Decision(flies, flies)
