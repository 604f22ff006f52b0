"""Rollouts of decisions, which last a step or several, such as chunks of actions.

A decision is credited with all rewards until the next one: for the learner it is one action, after which so many steps
have passed (a semi-Markov decision process). Each rollout starts with new decisions in all worlds, so that nothing is
half decided between two of them.
"""

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from aerial_il.algorithms.online.collector import Collector, Transition
from aerial_il.algorithms.run.state import Part


class Acted(NamedTuple):
    """What one step was flown by.

    Attributes:
        obs: (n, Do) what decisions see; of meaning where one was made. decided: (n,) bool, a decision starts here.
        raw: (n, R) the sample behind it. actions: (n, Da) in the environment's units.
        learner: (n,) bool, they are the learner's; None for all of them.
        normalised: (n, Da) the same as the network answers, of who decides in every step; None of others.
    """

    obs: np.ndarray
    decided: np.ndarray
    raw: np.ndarray
    actions: np.ndarray
    learner: np.ndarray | None = None
    normalised: np.ndarray | None = None


class Decisions(NamedTuple):
    """T steps of n worlds.

    Attributes:
        obs, decided, raw: see :class:`Acted`. next_obs: (T, n, Do) what a decision after the step would see.
        rewards: (T, n). terminal, truncated: (T, n) bool; see :class:`Transition`.
        normalised: (T, n, Da), or None; see :class:`Acted`.
    """

    obs: np.ndarray
    decided: np.ndarray
    raw: np.ndarray
    next_obs: np.ndarray
    rewards: np.ndarray
    terminal: np.ndarray
    truncated: np.ndarray
    normalised: np.ndarray | None = None

    @property
    def ended(self) -> np.ndarray:
        """(T, n) bool, the step was the last of its episode."""
        return self.terminal | self.truncated

    def flat(self, name: str) -> np.ndarray:
        """Return one entry as (T * n, ...)."""
        values = getattr(self, name)
        return values.reshape(-1, *values.shape[2:])


class Pilot(Part, ABC):
    """Decides now and then in each world of a collector, and acts in every step.

    Args:
        collector: whose worlds these are.
    """

    def __init__(self, collector: Collector) -> None:
        self._collector = collector

    @property
    def flown(self) -> int:
        """Environment steps that the learner has flown."""
        return self._collector.steps

    @abstractmethod
    def cut(self) -> None:
        """Decide anew in all worlds."""

    @abstractmethod
    def act(self) -> Acted:
        """Return the actions for what the worlds show."""

    @abstractmethod
    def after(self, step: Transition) -> np.ndarray:
        """Follow one step; return what a decision after it would see (n, Do), before any reset."""

    def standardise(self) -> None:
        """Standardise observations by all that was seen so far; a clone goes on to see them as it did."""

    def collect(self, steps: int) -> Decisions:
        """Take ``steps`` environment steps of all worlds together, or a few more."""
        rows, answers = list[tuple[np.ndarray, ...]](), list[np.ndarray]()
        self.cut()
        for _ in range(-(-steps // self._collector.n)):
            acted = self.act()
            step = self._collector.step(acted.actions, learner=acted.learner)
            rows.append((*acted[:3], self.after(step), step.rewards, step.terminal, step.truncated))
            answers += [] if acted.normalised is None else [acted.normalised]
        columns = (np.stack(values) for values in zip(*rows, strict=True))
        return Decisions(*columns, normalised=np.stack(answers) if answers else None)
