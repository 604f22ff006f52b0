"""Settings of reinforcement learning with demonstrations, and the rewards of these.

A demonstration is rewarded as the learner itself is: by the environment, as it was recorded; or, where the reward is
sparse, with 1 for the step that solved the task, which is its last where success ends an episode; or, with hindsight,
by the rule of its goal. Penalties for rough actions are subtracted in every case.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from aerial_il.algorithms.rl.collector import RewardScheme
from aerial_il.algorithms.rl.imitation import Imitation
from aerial_il.algorithms.rl.online_run import Problem
from aerial_il.algorithms.rl.reinforcement import Reinforcement, RelabelledReinforcement
from aerial_il.algorithms.rl.replay.demonstrations import Transitions
from aerial_il.algorithms.rl.replay.hindsight import goal_columns
from aerial_il.core.contracts import BatchEnv
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.goals import GoalColumns
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.network import PolicySettings

UNPAID = (
    "The demonstrations carry no reward: in none of their {} steps was anything paid. Pay for success alone "
    "(algorithm.reward=sparse), or record them again with what the environment pays."
)
UNSOLVED = (
    "None of the {} demonstrations succeeds, so that a sparse reward is nowhere in them. Set "
    "algorithm.reward=environment, or add some that succeed."
)
MEANT = (
    "labels=expert pairs what the demonstrator meant with the rewards of what was executed, so that critics would "
    "learn values of actions that nobody took: set algorithm.labels=executed."
)
NO_MOMENT = (
    "Success does not end an episode here, so that a demonstration does not tell at which of its steps it was solved, "
    "and cannot be paid for it. Set algorithm.reward=environment, or train where success ends an episode."
)
FLOWN_ON = (
    "Demonstration {} was not ended by its success, so that it cannot be told which step solved it. Set "
    "algorithm.reward=environment, or record it up to its success (no horizon=)."
)
TOO_LONG = (
    "The shortest demonstration takes {} steps, and episodes end after {}: nothing could be repeated in that time. "
    "Train with a longer time limit: {}={} at least."
)


@dataclass(frozen=True, kw_only=True)
class DemonstratedReinforcement(Reinforcement, Imitation):
    """Settings of reinforcement learning with demonstrations; stands before :class:`OffPolicy` among the bases.

    Beside those of :class:`Imitation`, of which ``control`` cannot be ``constant_reward`` here:

    Attributes:
        failures: learn from failed episodes of the dataset too; rewards tell them from the others.
        absorbing: whether success that ends an episode leads to an absorbing state with its reward; a crash never does.
    """

    rewarded: ClassVar[bool] = True

    failures: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.control == "constant_reward":
            raise InvalidValueError(f"{self.name} learns from a reward: control is none or random_actions.")
        if self.labels == "expert":
            raise InvalidValueError(MEANT)

    @property
    def learns_from_failures(self) -> bool:
        return self.failures

    @property
    def learns_recorded_rewards(self) -> bool:
        """Whether what demonstrations were paid, or their success, has to say something."""
        return self.control == "none"

    @property
    def forfeits_by_success(self) -> bool:
        return super().forfeits_by_success and not self.absorbing

    def problem(self, dataset: Iterable[Episode] | None, policy: PolicySettings, env: BatchEnv, seed: int) -> Problem:
        """Read the demonstrations and reward them as the learner is rewarded.

        Raises:
            InvalidValueError: they carry no reward that could be learned from, or are longer than episodes here.
        """
        episodes = list(dataset or ())
        check_lengths(episodes, env.spec)
        if self.learns_recorded_rewards:
            check_paid(episodes, sparse=self.reward == "sparse")
        return super().problem([with_rewards(e, self.scheme, env) for e in episodes], policy, env, seed)


@dataclass(frozen=True, kw_only=True)
class RelabelledDemonstrated(RelabelledReinforcement, DemonstratedReinforcement):
    """Settings of those whose own flights can be relabelled with other goals.

    With ``hindsight`` demonstrations count for their own goals, rewarded by the same rule, and there is no absorbing
    state: critics bootstrap through success.
    """

    @property
    def learns_recorded_rewards(self) -> bool:
        return super().learns_recorded_rewards and not self.hindsight.goals

    def problem(self, dataset: Iterable[Episode] | None, policy: PolicySettings, env: BatchEnv, seed: int) -> Problem:
        """Read the demonstrations, and reward them as the learner is rewarded.

        Raises:
            InvalidValueError: also where hindsight finds no goal that it could exchange.
        """
        found = super().problem(dataset, policy, env, seed)
        if not self.hindsight.goals or found.demos is None:
            return found
        goal = goal_columns(env, found.interface.layout)
        return replace(found, demos=rewarded_by(goal, found.demos, tolerance=self.hindsight.tolerance))


def rewarded_by(goal: GoalColumns, demos: Transitions, *, tolerance: float) -> Transitions:
    """Return transitions rewarded by the rule of their own goals, in which success is no end."""
    rewards = goal.rewards(demos.next_frames, tolerance=tolerance) - demos.penalties
    return demos._replace(rewards=rewards, terminal=demos.terminal & ~demos.success)


def check_paid(episodes: Sequence[Episode], *, sparse: bool) -> None:
    """Raise :class:`InvalidValueError` where episodes were recorded without rewards, or none has a sparse one."""
    if sparse and episodes and not any(episode.success for episode in episodes):
        raise InvalidValueError(UNSOLVED.format(len(episodes)))
    if episodes and not sparse and not any(episode.rewards.any() for episode in episodes):
        raise InvalidValueError(UNPAID.format(sum(map(len, episodes))))


def check_lengths(episodes: Sequence[Episode], spec: EnvSpec) -> None:
    """Raise :class:`InvalidValueError` where no demonstration fits into an episode of ``spec.max_steps``."""
    shortest = min(map(len, episodes), default=0)
    if shortest > spec.max_steps:
        key = "max_steps" if spec.is_outside else "horizon"
        raise InvalidValueError(TOO_LONG.format(shortest, spec.max_steps, key, shortest))


def with_rewards(episode: Episode, scheme: RewardScheme, env: BatchEnv) -> Episode:
    """Return a demonstration rewarded by ``scheme`` as if it had been flown in ``env``, penalties left out.

    Raises:
        InvalidValueError: a reward is not finite, or it is not known which step solved the task.
    """
    paid = np.asarray(episode.rewards, float)
    if scheme.sparse:
        paid = _solved(episode, env)
    elif not np.isfinite(paid).all():
        step = int(np.argmin(np.isfinite(paid)))
        raise InvalidValueError(f"Episode {episode.uid}: the reward is not finite at step {step}.")
    return replace(episode, rewards=paid)


def _solved(episode: Episode, env: BatchEnv) -> np.ndarray:
    """Return 1 for the step that solved the task, else 0, (T,)."""
    found = np.zeros(len(episode))
    if not episode.success:
        return found
    if not env.ends_at_success:
        raise InvalidValueError(NO_MOMENT)
    if episode.truncated[-1]:
        raise InvalidValueError(FLOWN_ON.format(episode.uid))
    found[-1] = 1.0
    return found
