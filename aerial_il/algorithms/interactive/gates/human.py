"""The gate of HG-DAgger: a supervisor takes over when it sees fit and hands back.

Source: M. Kelly et al., "HG-DAgger: interactive imitation learning with human experts", ICRA 2019: algorithm 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from aerial_il.algorithms.interactive.disagreement import ActionScale
from aerial_il.algorithms.interactive.gates.gate import GateSettings, Round
from aerial_il.algorithms.interactive.mixture import Decision, Gate, GateInput
from aerial_il.algorithms.interactive.supervisors import Corrector, Supervisor


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
