"""The one on-policy loop: fly a rollout, judge what was done in it, learn from it, and forget it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np

from aerial_il.algorithms.on_policy.advantages import Judged, RewardNorm
from aerial_il.algorithms.on_policy.gate import ReturnGate
from aerial_il.algorithms.on_policy.hand_over import HandOver
from aerial_il.algorithms.on_policy.settings import Rollout
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.run.state import Stateful
from aerial_il.policies.parts.network import ChunkNetwork


class Settings(Protocol):
    """What the loop reads of an algorithm's settings."""

    @property
    def rollout(self) -> Rollout: ...
    @property
    def gamma(self) -> float: ...
    @property
    def gae_lambda(self) -> float: ...


class Flown(Protocol):
    """T steps of n worlds."""

    @property
    def rewards(self) -> np.ndarray: ...
    @property
    def ended(self) -> np.ndarray: ...


class Agent(Stateful, Protocol):
    """What learns: an actor, and the critic by which its decisions are judged."""

    def values(self, obs: np.ndarray) -> np.ndarray:
        """Return the critic's values (...) of what decisions see (..., Do)."""
        ...

    def learn(self, found: Judged, *, left: float, improve: bool) -> Mapping[str, float]:
        """Learn from one rollout's decisions, and return named numbers.

        Args:
            left: share of the training that is left. improve: whether the actor is updated; else the critic alone.
        """
        ...


class Flights[F: Flown](Protocol):
    """How worlds are flown between two turns of learning."""

    @property
    def parts(self) -> Mapping[str, Stateful]:
        """What changes on the way, by name."""
        ...

    @property
    def flown(self) -> int:
        """Environment steps that the learner has flown."""
        ...

    def standardise(self, rollout: F | None = None) -> None:
        """Let the run standardise observations by all that was seen, with a ``rollout`` that was learned from."""
        ...

    def collect(self, steps: int) -> F:
        """Take ``steps`` environment steps of all worlds together, or a few more."""
        ...

    def judged(
        self, rollout: F, rewards: np.ndarray, agent: Agent, settings: Settings, end_values: np.ndarray | float
    ) -> Judged | None:
        """Return the decisions of a rollout with their generalised advantages; None if there are too few to compare.

        Args:
            rewards: (T, n) of each step. end_values: (T, n) of what follows a terminal step; elsewhere of no effect.
        """
        ...


def learn_on_policy[F: Flown](
    run: OnlineRun,
    settings: Settings,
    flights: Flights[F],
    agent: Agent,
    actor: ChunkNetwork,
    *,
    warmup: int = 0,
    rewarded: Callable[[F], tuple[np.ndarray, np.ndarray | float]] | None = None,
    gate: ReturnGate | None = None,
    hand_over: HandOver | None = None,
    told: Callable[[F], Mapping[str, float]] | None = None,
    parts: Mapping[str, Stateful] | None = None,
) -> None:
    """Fly and learn until no steps are left; the caller finishes the run.

    Args:
        actor: the network whose policy is evaluated on the way and saved.
        warmup: steps of the learner up to which it flies as it is, while the critic alone learns.
        rewarded: gives the rewards (T, n) of a rollout, and the values after terminal steps; None for those of the
            environment, divided by the running deviation of returns, with nothing after an end.
        gate: gives up what flew worse than it began. hand_over: decides what is evaluated and saved.
        told: further numbers of a rollout for the metrics. parts: what else changes, by name.
    """
    reward_norm = RewardNorm(run.collector.n, settings.gamma)

    def scaled(rollout: F) -> tuple[np.ndarray, float]:
        return reward_norm.scale(rollout.rewards, rollout.ended), 0.0

    changing = {"agent": agent, **flights.parts, "gate": gate, "hand_over": hand_over, **(parts or {})}
    changing |= {} if rewarded else {"reward_norm": reward_norm}
    run.begin(actor, {name: part for name, part in changing.items() if part is not None})
    flights.standardise()
    while run.goes_on():
        warming_up = flights.flown < warmup
        rollout = flights.collect(settings.rollout.steps)
        improve = gate.passes(rollout.rewards, rollout.ended, warming_up=warming_up) if gate else not warming_up
        rewards, end_values = (rewarded or scaled)(rollout)
        run.log(told(rollout) if told else {})
        if found := flights.judged(rollout, rewards, agent, settings, end_values):
            run.log({**agent.learn(found, left=run.left, improve=improve), "critic/value": found.value})
            run.log({"actor/fallbacks": float(not (improve or warming_up))} if gate else {})
            run.log(hand_over.after_learning() if hand_over and improve else {})
        flights.standardise(rollout)
        run.end_turn()
