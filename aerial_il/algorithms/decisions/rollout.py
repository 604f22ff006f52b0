"""Rollouts of decisions that last several steps, such as chunks of actions, and their advantages.

A decision is credited with all rewards until the next one: for the learner it is one action, after which so many steps
have passed (a semi-Markov decision process). Each rollout begins with new decisions in all worlds, so that nothing is
half decided between two of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from aerial_il.algorithms.online.collector import Collector, Transition
from aerial_il.algorithms.ppo import Advantages
from aerial_il.algorithms.run.state import Snapshot, Stateful
from aerial_il.core.tensors import tensor


class Acted(NamedTuple):
    """What one step was flown by.

    Attributes:
        obs: (n, Do) what decisions see; of meaning where one was made. decided: (n,) bool, a decision begins here.
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
        obs, decided, raw: see :class:`Acted`. after: (T, n, Do) what a decision after the step would see.
        rewards: (T, n). terminal, truncated: (T, n) bool; see :class:`Transition`.
    """

    obs: np.ndarray
    decided: np.ndarray
    raw: np.ndarray
    after: np.ndarray
    rewards: np.ndarray
    terminal: np.ndarray
    truncated: np.ndarray

    @property
    def ended(self) -> np.ndarray:
        """(T, n) bool, the step was the last of its episode."""
        return self.terminal | self.truncated


def collect_decisions(collector: Collector, pilot: Pilot, steps: int) -> Decisions:
    """Take ``steps`` environment steps of all worlds together, or a few more, as ``pilot`` flies."""
    rows: list[tuple[np.ndarray, ...]] = []
    pilot.cut()
    for _ in range(-(-steps // collector.n)):
        acted = pilot.act()
        step = collector.step(acted.actions, learner=acted.learner)
        after = pilot.after(step)
        rows.append((*acted[:3], after, step.rewards, step.terminal, step.truncated))
    return Decisions(*(np.stack(values) for values in zip(*rows, strict=True)))


class Judged(NamedTuple):
    """Every decision of a rollout as a learner takes it, and the mean value of the states they were made in."""

    data: Advantages
    value: float


def judged(
    decisions: Decisions,
    values: Callable[[np.ndarray], np.ndarray],
    rewards: np.ndarray,
    *,
    gamma: float,
    gae_lambda: float,
) -> Judged:
    """Return the decisions with their generalised advantages.

    Args:
        values: of what decisions see, (..., Do) -> (...). rewards: (T, n) of each step.
        gamma: discount of a step. gae_lambda: lambda, counted in decisions.
    """
    worth = values(decisions.obs)
    found, closing = advantages(decisions, worth, values(decisions.after), rewards, gamma=gamma, gae_lambda=gae_lambda)
    made = decisions.decided
    steps, worlds = np.nonzero(made)
    arrays = (
        decisions.obs[made],
        decisions.after[closing[steps, worlds], worlds],
        decisions.raw[made],
        found[made],
        (found + worth)[made],
    )
    return Judged(Advantages(*(tensor(np.asarray(a, np.float32)) for a in arrays)), float(worth[made].mean()))


def advantages(
    decisions: Decisions,
    values: np.ndarray,
    after: np.ndarray,
    rewards: np.ndarray,
    *,
    gamma: float,
    gae_lambda: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return generalised advantages (T, n) where decisions were made, and the step (T, n) at which each one closed.

    ``A_t = R_t + gamma^k V(s_{t+k}) - V(s_t) + gamma^k lambda A_{t+k}``, where the decision of step t lasted k steps
    with ``R_t`` as the sum of their discounted rewards. The value after a terminal step is zero; a decision that is cut
    by a time limit, or by the end of the rollout, bootstraps from the critic there.

    Args:
        values, after: (T, n) the critic's of ``decisions.obs`` and ``decisions.after``. rewards: (T, n).

    Source: R. Sutton, D. Precup, S. Singh, "Between MDPs and semi-MDPs", 1999, section 3, for one decision; J. Schulman
    et al., "High-Dimensional Continuous Control Using Generalized Advantage Estimation", 2016, for their sum.
    """
    steps, worlds = rewards.shape
    found, closing = np.zeros((steps, worlds)), np.zeros((steps, worlds), np.int64)
    paid, left, later = np.zeros(worlds), np.ones(worlds), np.zeros(worlds)
    closed_at = np.zeros(worlds, np.int64)
    for t in reversed(range(steps)):
        ended, made = decisions.ended[t], decisions.decided[t]
        closes = ended | (decisions.decided[t + 1] if t + 1 < steps else True)
        tail = np.where(decisions.terminal[t], 0.0, after[t])
        paid = rewards[t] + gamma * np.where(closes, tail, paid)
        left, later = gamma * np.where(closes, 1.0, left), np.where(ended, 0.0, later)
        closed_at = np.where(closes, t, closed_at)
        found[t] = np.where(made, paid - values[t] + gae_lambda * left * later, 0.0)
        closing[t], later = closed_at, np.where(made, found[t], later)
    return found, closing


class Returns:
    """Returns of the episodes of n worlds, across rollouts."""

    def __init__(self, worlds: int) -> None:
        self._running = np.zeros(worlds)

    def ended(self, decisions: Decisions) -> np.ndarray:
        """Take a rollout in; return the returns (k,) of the episodes that ended in it."""
        found: list[float] = []
        for rewards, over in zip(decisions.rewards, decisions.ended, strict=True):
            self._running = self._running + rewards
            found += self._running[over].tolist()
            self._running = np.where(over, 0.0, self._running)
        return np.array(found)

    def snapshot(self) -> Snapshot:
        return Snapshot({"running": self._running.copy()})

    def restore(self, saved: Snapshot) -> None:
        self._running = saved.arrays["running"].copy()
