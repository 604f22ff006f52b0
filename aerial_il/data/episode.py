"""One recorded flight as arrays."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from aerial_il.core.specs import EnvSpec
from aerial_il.data.provenance import instruction_of

PERTURBATION = "perturbation"  # topic of what met a vehicle in each step: a push of its base (3,), whether fingers slip


@dataclass(frozen=True, eq=False)
class Episode:
    """A flight of T control steps: T + 1 observations and states, T actions and their outcomes.

    Attributes:
        uid: unique name, equal for equal flights.
        spec: the environment it was flown in.
        provenance: who flew it with what; plain JSON values.
        obs: field name -> ``(T + 1, *shape)``; image fields only where they were asked for.
        actions: (T, Da) as commanded.
        executed_actions: (T, Da) as executed, after clipping or a person's correction.
        expert_actions: (T, Da) what the expert would have done, NaN where nobody was asked.
        is_intervention: (T,) bool, a person or the expert had taken over.
        phase: (T,) int, index into ``provenance["phases"]``, -1 where there is none.
        rewards: (T,) in [0, 1] in this suite, as they come elsewhere.
        terminated, truncated: (T,) bool, true at most on the last step.
        states: (T + 1, S) float64 full simulator states, before each step and after the last.
        ctrl: (T, nu) actuator controls after each step.
        sim_time: (T + 1,) seconds.
        success: whether the task was solved.
        model_xml: the compiled scene it was flown in.
        extras: name -> (T, k) further numbers of each step that the recorder was asked to keep.
        extra_labels: name -> their k labels.
    """

    uid: str
    spec: EnvSpec
    provenance: Mapping[str, Any]
    obs: Mapping[str, np.ndarray]
    actions: np.ndarray
    executed_actions: np.ndarray
    expert_actions: np.ndarray
    is_intervention: np.ndarray
    phase: np.ndarray
    rewards: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    states: np.ndarray
    ctrl: np.ndarray
    sim_time: np.ndarray
    success: bool
    model_xml: str
    extras: Mapping[str, np.ndarray] = field(default_factory=dict)
    extra_labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def __repr__(self) -> str:
        where, end = f"{self.spec.robot}/{self.spec.task}", "success" if self.success else "no success"
        return f"Episode({self.uid}: {len(self)} steps of {where}, {end}, {', '.join(self.obs)})"

    def __len__(self) -> int:
        """Return the number of control steps T."""
        return len(self.actions)

    @property
    def instruction(self) -> str:
        """What was to be done: its own words, where the instructions of a dataset differ, else those of its task."""
        return instruction_of(self.provenance, self.spec)

    @property
    def nbytes(self) -> int:
        """How much memory its arrays take."""
        held = [getattr(self, each.name) for each in fields(self)]
        return sum(each.nbytes for each in (*held, *self.obs.values()) if isinstance(each, np.ndarray))

    @property
    def seed(self) -> int:
        return int(self.provenance["seed"])

    @property
    def total_reward(self) -> float:
        return float(self.rewards.sum())

    @property
    def is_terminal(self) -> bool:
        """Whether nothing can follow it: the environment ended it, or success did; not time, nor the end of a file."""
        solved = self.success and not self.truncated[-1] and not self.spec.is_foreign
        return bool(self.terminated[-1] or solved)

    @property
    def asked(self) -> np.ndarray:
        """(T,) bool, the steps in which the expert was asked."""
        return np.asarray(~np.isnan(self.expert_actions).any(axis=1))

    @property
    def known(self) -> np.ndarray:
        """(T,) bool, the steps to learn from: those with a label, or all where the expert was never asked."""
        return self.asked if self.asked.any() else np.ones(len(self), bool)

    @property
    def labels(self) -> np.ndarray:
        """(T, Da) what is to be learned: what the expert would have done, and where nobody was asked :attr:`done`."""
        return np.where(self.asked[:, None], self.expert_actions, self.done)

    @property
    def done(self) -> np.ndarray:
        """(T, Da) what was done: as executed, but for fingers that were made to slip, as commanded."""
        if PERTURBATION not in self.extras:
            return self.executed_actions
        slipped = self.extras[PERTURBATION][:, -1:] > 0.0
        return np.where(slipped, self.actions, self.executed_actions)

    def flat_obs(self, names: tuple[str, ...]) -> np.ndarray:
        """Concatenate fields to (T + 1, D) in the order of ``names``."""
        return self.spec.observation.flatten(self.obs, names)
