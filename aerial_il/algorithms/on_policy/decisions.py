"""Rollouts of decisions that last several steps, such as chunks of actions.

A decision is credited with all rewards until the next one: for the learner it is one action, after which so many steps
have passed (a semi-Markov decision process). Each rollout starts with new decisions in all worlds, so that nothing is
half decided between two of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from aerial_il.algorithms.online.collector import Collector, Transition
from aerial_il.algorithms.run.state import Stateful


class Acted(NamedTuple):
    """What one step was flown by.

    Attributes:
        obs: (n, Do) what decisions see; of meaning where one was made. decided: (n,) bool, a decision starts here.
        raw: (n, R) the sample behind it. actions: (n, Da) in the environment's units.
        learner: (n,) bool, they are the learner's; None for all of them.
    """

    obs: np.ndarray
    decided: np.ndarray
    raw: np.ndarray
    actions: np.ndarray
    learner: np.ndarray | None = None


class Pilot(Stateful, Protocol):
    """Decides now and then in each world of a collector, and acts in every step."""

    @property
    def flown(self) -> int:
        """Environment steps that the learner has flown."""
        ...

    def cut(self) -> None:
        """Decide anew in all worlds."""
        ...

    def act(self) -> Acted:
        """Return the actions for what the worlds show."""
        ...

    def after(self, step: Transition) -> np.ndarray:
        """Follow one step; return what a decision after it would see (n, Do), before any reset."""
        ...


class Decisions(NamedTuple):
    """T steps of n worlds.

    Attributes:
        obs, decided, raw: see :class:`Acted`. next_obs: (T, n, Do) what a decision after the step would see.
        rewards: (T, n). terminal, truncated: (T, n) bool; see :class:`Transition`.
    """

    obs: np.ndarray
    decided: np.ndarray
    raw: np.ndarray
    next_obs: np.ndarray
    rewards: np.ndarray
    terminal: np.ndarray
    truncated: np.ndarray

    lasts_a_step = False  # a decision, but for the shortest

    @property
    def ended(self) -> np.ndarray:
        """(T, n) bool, the step was the last of its episode."""
        return self.terminal | self.truncated


class DecisionFlights:
    """Flies worlds as a pilot decides.

    Args:
        collector: whose worlds these are. pilot: decides in them.
    """

    def __init__(self, collector: Collector, pilot: Pilot) -> None:
        self._collector, self._pilot = collector, pilot

    @property
    def parts(self) -> Mapping[str, Stateful]:
        return {"pilot": self._pilot}

    @property
    def flown(self) -> int:
        return self._pilot.flown

    def standardise(self, rollout: Decisions | None = None) -> None:
        """Leave observations as the clone saw them."""

    def collect(self, steps: int) -> Decisions:
        collector, pilot = self._collector, self._pilot
        rows: list[tuple[np.ndarray, ...]] = []
        pilot.cut()
        for _ in range(-(-steps // collector.n)):
            acted = pilot.act()
            step = collector.step(acted.actions, learner=acted.learner)
            after = pilot.after(step)
            rows.append((*acted[:3], after, step.rewards, step.terminal, step.truncated))
        return Decisions(*(np.stack(values) for values in zip(*rows, strict=True)))
