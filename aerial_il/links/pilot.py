"""What flies a robot over a link: a policy that is not asked while something is wrong, and that may think for long.

A policy that answers within a tick is asked in it. One that does not thinks on another thread, while what it planned
before is flown on: its answer to what was seen at a tick is flown a fixed number of ticks later, without the actions
that came too late, so that the flight does not depend on how fast it thought, as long as it was fast enough. Where
chunks join, the step between them may be spread over some ticks.
"""

import time
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np

from aerial_il.core.contracts import BatchEnv, Observation, Policy, attach, begin_episodes
from aerial_il.core.errors import InvalidValueError
from aerial_il.links.loop import RobotLoop
from aerial_il.policies.parts.flying import FlyingPolicy, Question

TRIED = 20  # answers that are timed before a flight
MARGIN = 1.25  # over the slowest of them


class LinkPilot:
    """Flies a policy in a :class:`~aerial_il.links.environment.LinkedEnvironment`, or in a loop of its own.

    Args:
        policy: what flies. think_ticks: ticks from what is seen to the answer being flown; 0: within the tick.
        blend_ticks: over which the step from one chunk to the next is spread; 0: not at all.

    Attributes:
        starved: ticks of the flight in which nothing was planned.

    Raises:
        InvalidValueError: thinking for longer is for policies that fly chunks.
    """

    def __init__(self, policy: Policy, *, think_ticks: int = 0, blend_ticks: int = 0) -> None:
        if (think_ticks or blend_ticks) and not isinstance(policy, FlyingPolicy):
            raise InvalidValueError("think_ms and blend_ms are for policies that fly chunks; this one does not.")
        self.policy, self._ticks, self._blend = policy, think_ticks, blend_ticks
        self._thinker = ThreadPoolExecutor(1, "policy") if think_ticks else None
        self.loop: RobotLoop | None = None
        self.starved = 0
        self._forget()

    @property
    def execution(self) -> Any:
        """How the policy flies its chunks."""
        return getattr(self.policy, "execution", None)

    def attach(self, env: BatchEnv) -> None:
        attach(self.policy, env)
        self.loop = getattr(env, "loop", None)

    def begin(self, seeds: np.ndarray, mask: np.ndarray | None = None) -> None:
        begin_episodes(self.policy, seeds, mask)
        self.starved = 0

    def reset(self, mask: np.ndarray | None = None) -> None:
        self.policy.reset(mask)
        self._forget()

    def act(self, obs: Observation) -> np.ndarray:
        """Return the action (1, Da); while something is wrong with the robot, the last one, which is not sent."""
        if self.loop is not None and self.loop.trouble:
            self._lost = True
            return self._last_or_nothing()
        if self._lost:
            self.reset()
        self._last = self._smoothed(self._in_time(obs))
        return self._last

    def made_of(self, world: int) -> Mapping[str, Any]:
        """Return how the flight kept time, for its provenance."""
        loop = self.loop
        if loop is None:
            return {}
        ticks = {"held_ticks": loop.held, "starved_ticks": self.starved, "think_ticks": self._ticks}
        return {**ticks, "timing": loop.timing.summary()}

    def objection(self, world: int) -> str:
        """Return why a success is no demonstration: in held ticks, what is recorded as the action was not sent."""
        if self.loop is None or not self.loop.held:
            return ""
        held, why = self.loop.troubles[self.loop.seed]
        return f"the robot hovered by itself for {held} ticks: {why}"

    def close(self) -> None:
        """Wait for the last thought."""
        if self._thinker:
            self._thinker.shutdown()

    def _forget(self) -> None:
        self._asked: tuple[Question, Future[np.ndarray], int] | None = None
        self._tick, self._lost = 0, False
        self._last: np.ndarray | None = None
        self._step, self._left, self._joined = np.zeros(0), 0, False

    def _in_time(self, obs: Observation) -> np.ndarray:
        if self._thinker is None:
            return self._within_the_tick(obs)
        policy = self.policy
        assert isinstance(policy, FlyingPolicy)
        question = policy.look(obs)
        if self._asked is None and question is not None:
            kept = replace(
                question, history=question.history.copy(), images={n: i.copy() for n, i in question.images.items()}
            )
            self._asked = kept, self._thinker.submit(policy.think, kept), self._tick + self._ticks
        self._answer(policy)
        self._tick += 1
        if policy.planned:
            return policy.next()
        self.starved += 1
        return self._last_or_nothing()

    def _within_the_tick(self, obs: Observation) -> np.ndarray:
        policy = self.policy
        if not self._blend or not isinstance(policy, FlyingPolicy):
            return np.asarray(policy.act(obs), float)
        self._joined |= policy.advance(obs)
        return policy.next()

    def _answer(self, policy: FlyingPolicy) -> None:
        """Plan what was thought, once its tick has come."""
        if self._asked is None:
            return
        question, thought, due = self._asked
        if self._tick < due:
            return
        if not (self.loop is not None and self.loop.link.lockstep) and not thought.done():
            return
        policy.plan(question, thought.result())
        for _ in range(min(self._tick - due, policy.config.chunk - 1)):  # thought for longer than it had
            if policy.planned:
                policy.next()
        self._asked, self._joined = None, True

    def _last_or_nothing(self) -> np.ndarray:
        if self._last is not None:
            return self._last
        assert self.loop is not None
        return self.loop.hold()[None]

    def _smoothed(self, wanted: np.ndarray) -> np.ndarray:
        """Return ``wanted`` (1, Da) and what is left of the step to the newest chunk."""
        if self._joined and self._last is not None and self._blend:
            self._step, self._left = self._last - wanted, self._blend
        self._joined = False
        if self._left:
            self._left -= 1
            wanted = wanted + self._left / self._blend * self._step
        return wanted


def ticks_to_think(policy: FlyingPolicy, obs: Observation, control_dt_s: float) -> int:
    """Return how many ticks a policy needs for an answer to ``obs`` (name -> (1, ...)): 0 if it fits into half of one.

    The slowest of 20 answers counts, with a quarter more; the policy's memory is empty afterwards.
    """
    slowest = 0.0
    for _ in range(TRIED):
        policy.reset()
        question = policy.look(obs)
        assert question is not None
        started = time.perf_counter()
        policy.think(question)
        slowest = max(slowest, time.perf_counter() - started)
    policy.reset()
    return 0 if MARGIN * slowest < 0.5 * control_dt_s else int(np.ceil(MARGIN * slowest / control_dt_s))
