"""Hindsight experience replay: an episode that missed its goal is stored again with goals that it did reach.

An environment specifies which fields of its observations expose the goal, and the reward for any other goal
(:mod:`aerial_il.core.goals`). All transitions are rewarded by that rule, those with the original goal too. Success is
not terminal; the critic bootstraps through it. Every other end is terminal. Where episodes end in crashes the reward
must therefore be 1 when the goal is reached, not -1 until then: to crash would be the way out.

Source: M. Andrychowicz et al., "Hindsight Experience Replay", 2017, section 4.5: strategies ``future`` and ``final``.
"""

from typing import NamedTuple

import numpy as np

from aerial_il.algorithms.off_policy.settings import Hindsight
from aerial_il.algorithms.online.collector import Transition
from aerial_il.algorithms.run.state import Snapshot
from aerial_il.core.contracts import BatchEnv
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.goals import GoalColumns
from aerial_il.policies.parts.layout import Layout


def goal_columns(env: BatchEnv, layout: Layout) -> GoalColumns:
    """Return where the frames of ``layout`` show the goal of ``env``.

    Raises:
        InvalidValueError: the environment exposes no goal, or the policy does not see it.
    """
    if env.goal_spec is None:
        hint = "Set algorithm.hindsight.goals=0."
        raise InvalidValueError(f"{env.spec.robot}:{env.spec.task} exposes no goal that could be exchanged. {hint}")
    env.goal_spec.check(env.spec.observation)
    return GoalColumns(env.goal_spec, layout.spec.observation.parts(layout.names))


class Flown(NamedTuple):
    """T transitions of one episode.

    Attributes:
        frames, next_frames: (T, Do) in the world. actions: (T, Da) normalised.
        penalties: (T,) for rough actions. lost: (T,) bool, the episode ended otherwise than by success.
    """

    frames: np.ndarray
    actions: np.ndarray
    next_frames: np.ndarray
    penalties: np.ndarray
    lost: np.ndarray


class Relabeller:
    """The episodes that run in n worlds, relabelled with other goals when they end.

    Args:
        settings: how often and how. goal: of the environment, in frames. worlds: n. rng: samples the goals.
    """

    def __init__(self, settings: Hindsight, goal: GoalColumns, worlds: int, rng: np.random.Generator) -> None:
        self._settings, self.goal, self._rng = settings, goal, rng
        self._running: list[list[tuple[np.ndarray, ...]]] = [[] for _ in range(worlds)]

    def rewards(self, step: Transition) -> np.ndarray:
        """Return the rewards of one step of all worlds for its own goals, (n,)."""
        return self._paid(step.next_frames) - step.penalties

    def add(self, step: Transition, actions: np.ndarray) -> list[tuple[np.ndarray, ...]]:
        """Take one step of all worlds in, with normalised ``actions`` (n, Da).

        Returns:
            For each episode that ended with it: frames, actions, rewards, next_frames, lost, with other goals.
        """
        lost = step.terminal & ~step.success
        for i, running in enumerate(self._running):
            running.append((step.frames[i], actions[i], step.next_frames[i], step.penalties[i], lost[i]))
        ended = np.flatnonzero(step.terminal | step.truncated)
        again = [self._again(Flown(*map(np.stack, zip(*self._running[i], strict=True)))) for i in ended]
        for i in ended:
            self._running[i] = []
        return again

    def _again(self, episode: Flown) -> tuple[np.ndarray, ...]:
        """Return an episode's transitions with goals that it achieved, each ``goals`` times."""
        steps = np.repeat(np.arange(len(episode.frames)), self._settings.goals)
        last = len(episode.frames) - 1
        final = self._settings.strategy == "final"
        when = np.full(len(steps), last) if final else self._rng.integers(steps, last + 1)
        goals = self.goal.achieved(episode.next_frames[when])
        frames, next_frames = (
            self.goal.exchanged(seen[steps], goals) for seen in (episode.frames, episode.next_frames)
        )
        rewards = self._paid(next_frames) - episode.penalties[steps]
        return frames, episode.actions[steps], rewards, next_frames, episode.lost[steps]

    def _paid(self, next_frames: np.ndarray) -> np.ndarray:
        """Return the rewards (T,) of steps that led to ``next_frames`` (T, Do)."""
        return self.goal.rewards(next_frames, tolerance=self._settings.tolerance)

    def snapshot(self) -> Snapshot:
        lengths = np.array([len(running) for running in self._running])
        flown = [step for running in self._running for step in running]
        columns = zip(*flown, strict=True) if flown else ()
        arrays = {name: np.stack(rows) for name, rows in zip(Flown._fields, columns, strict=bool(flown))}
        return Snapshot({"lengths": lengths, **arrays}, {"rng": self._rng.bit_generator.state})

    def restore(self, saved: Snapshot) -> None:
        self._rng.bit_generator.state = saved.values["rng"]
        lengths = saved.arrays["lengths"]
        if not lengths.any():
            self._running = [[] for _ in lengths]
            return
        flown = list(zip(*(saved.arrays[name] for name in Flown._fields), strict=True))
        ends = np.cumsum(lengths)
        self._running = [flown[end - length : end] for end, length in zip(ends, lengths, strict=True)]
