"""A mixture of learner and expert: a gate decides, world by world and step by step, which of them flies.

Every step is recorded as it was: the action that was executed, the expert's where it was asked, and who flew.
"""

import copy
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from aerial_il.algorithms.interactive.disagreement import ActionScale
from aerial_il.core.contracts import (
    BatchEnv,
    Observation,
    PhasedPolicy,
    Policy,
    SeededPolicy,
    attach,
    label_of,
    phase_names_of,
    phase_of,
)

IGNORED = 1.0  # distance of action and advice, in spreads of demonstrated actions, that counts as ignoring it
SAME = 0.1  # distance, in the same unit, up to which two pieces of advice are one
IGNORED_STEPS = 50  # in a row after which the expert is reset


@dataclass(frozen=True)
class GateInput:
    """What a gate may look at before a step of n worlds.

    Attributes:
        obs: ``name -> (n, ...)``.
        learner_action: (n, Da) what the learner would do.
        expert_action: (n, Da) what the expert would do. A gate whose answer depends on a row of it has asked: see
            :meth:`Gate.decide`.
        expert_flew: (n,) bool, the expert flew in the step before.
    """

    obs: Observation
    learner_action: np.ndarray
    expert_action: np.ndarray
    expert_flew: np.ndarray


@dataclass(frozen=True)
class Decision:
    """A gate's answer.

    Attributes:
        expert_flies: (n,) bool.
        asked: (n,) bool, the expert's action is a label, and a query; wherever it flies it has been asked.
    """

    expert_flies: np.ndarray
    asked: np.ndarray


class Gate(Protocol):
    """Decides who flies. Its state has a row per world."""

    def begin(self, seeds: np.ndarray, mask: np.ndarray) -> None:
        """Start the episodes of ``seeds`` (n,) in the worlds of ``mask`` (n,) bool."""
        ...

    def decide(self, given: GateInput) -> Decision:
        """Return who flies now.

        Only in rows that are answered with ``asked`` may the answer depend on ``given.expert_action``, or it would be a
        query that nobody counts. A supervisor's gate is free to: who may take over watches all the time.
        """
        ...


def newcomer_of(expert: Policy) -> Policy | None:
    """Return the same expert, to be attached and reset apart from it; None for one without phases to remember."""
    return copy.copy(expert) if isinstance(expert, PhasedPolicy) else None


class Mixture:
    """Flies for the learner or the expert, as the gate decides.

    Both are shown every state, so that whichever takes over knows where it is: the learner's plan is up to date, and an
    expert with phases follows the flight. What it is not asked for is not recorded. An expert whose advice has been
    ignored for a while is reset: what it believes to be going on is not.

    While the learner flies, an expert with phases may go by what it remembers of a flight that is not its own. A
    newcomer, the same expert without memory, is asked beside it: where the two differ, the advice follows from more
    than a policy can see, contradicts itself from flight to flight, and is no label.

    Args:
        learner: the policy in training.
        expert: whom to learn from.
        gate: who decides.
        scale: in which advice and action are compared; None never resets the expert.
        newcomer: the same expert once more, which is reset before each step; None takes all advice for a label.

    Attributes:
        expert_action: (n, Da) the expert's answers, NaN where it was not asked.
        is_intervention: (n,) bool, the expert flew.
    """

    def __init__(
        self,
        learner: Policy,
        expert: Policy,
        gate: Gate,
        scale: ActionScale | None = None,
        newcomer: Policy | None = None,
    ) -> None:
        self.learner, self.expert, self.gate, self.scale, self.newcomer = learner, expert, gate, scale, newcomer
        self._ignored = np.zeros(0, int)
        self.expert_action = np.zeros((0, 0))
        self.is_intervention = np.zeros(0, bool)

    @property
    def phase_names(self) -> tuple[str, ...]:
        return phase_names_of(self.expert)

    @property
    def phase(self) -> np.ndarray:
        """(n,) the expert's phases, -1 for one without."""
        return phase_of(self.expert, len(self.is_intervention))

    def attach(self, env: BatchEnv) -> None:
        attach(self.learner, env)
        attach(self.expert, env)
        if self.newcomer is not None:
            attach(self.newcomer, env)
        self.is_intervention, self._ignored = np.zeros(env.num_envs, bool), np.zeros(env.num_envs, int)

    def reset(self, mask: np.ndarray | None = None) -> None:
        self.learner.reset(mask)
        self.expert.reset(mask)
        self.is_intervention = np.zeros_like(self.is_intervention) if mask is None else self.is_intervention & ~mask
        self._ignored = np.zeros_like(self._ignored) if mask is None else np.where(mask, 0, self._ignored)

    def begin(self, seeds: np.ndarray, mask: np.ndarray | None = None) -> None:
        chosen = np.ones(len(seeds), bool) if mask is None else mask
        self.gate.begin(seeds, chosen)
        for policy in (self.learner, self.expert):
            if isinstance(policy, SeededPolicy):
                policy.begin(seeds, chosen)

    def act(self, obs: Observation) -> np.ndarray:
        of_learner = np.asarray(self.learner.act(obs), float)
        of_expert = np.asarray(self.expert.act(obs), float)
        label = label_of(self.expert, of_expert)  # before its own perturbation
        decision = self.gate.decide(GateInput(obs, of_learner, label, self.is_intervention))
        self.is_intervention = decision.expert_flies
        self._reset_ignored(of_learner, label)
        asked = decision.asked & self._unambiguous(obs, label) | decision.expert_flies
        self.expert_action = np.where(asked[:, None], label, np.nan)
        return np.where(decision.expert_flies[:, None], of_expert, of_learner)

    def _unambiguous(self, obs: Observation, label: np.ndarray) -> np.ndarray:
        """(n,) bool: whoever comes to this state without a memory gives the same advice."""
        if self.newcomer is None or self.scale is None:
            return np.ones(len(label), bool)
        self.newcomer.reset()
        other = label_of(self.newcomer, np.asarray(self.newcomer.act(obs), float))
        return self.scale.distance(label, other) <= SAME

    def _reset_ignored(self, of_learner: np.ndarray, label: np.ndarray) -> None:
        """Reset the expert in the worlds in which the learner has done something else for long."""
        if self.scale is None:
            return
        ignored = ~self.is_intervention & (self.scale.distance(of_learner, label) > IGNORED)
        self._ignored = np.where(ignored, self._ignored + 1, 0)
        lost = self._ignored >= IGNORED_STEPS
        if lost.any():
            self.expert.reset(lost)
            self._ignored[lost] = 0
