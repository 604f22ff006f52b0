"""The rewards of demonstrations: a demonstration is rewarded as the learner itself is.

By the environment, as it was recorded; or, where the reward is sparse, with 1 for the step that solved the task, which
is its last where success ends an episode; or, with hindsight, by the rule of its goal. Penalties for rough actions are
subtracted in every case.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aerial_il.algorithms.online.collector import RewardScheme, Transition
from aerial_il.core.contracts import BatchEnv
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.goals import GoalColumns
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode

UNPAID = (
    "The demonstrations carry no reward: in none of their {} steps was anything paid. Pay for success alone "
    "(algorithm.reward=sparse), or record them again with what the environment pays."
)
UNSOLVED = (
    "None of the {} demonstrations succeeds, so that a sparse reward is nowhere in them. Set "
    "algorithm.reward=environment, or add some that succeed."
)
NO_MOMENT = (
    "Success does not end an episode here, so that a demonstration does not tell at which of its steps it was solved, "
    "and cannot be paid for it. Set algorithm.reward=environment, or train where success ends an episode."
)
FLOWN_ON = (
    "Demonstration {} was not ended by its success, so that which step solved it is not known. Set "
    "algorithm.reward=environment, or record it up to its success (no horizon=)."
)
TOO_LONG = (
    "The shortest demonstration takes {} steps, and episodes end after {}: nothing could be repeated in that time. "
    "Train with a longer time limit: {}={} at least."
)


def rewarded_by(goal: GoalColumns, demos: Transition, *, tolerance: float) -> Transition:
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
    rewards = np.zeros(len(episode))
    if not episode.success:
        return rewards
    if not env.ends_at_success:
        raise InvalidValueError(NO_MOMENT)
    if episode.truncated[-1]:
        raise InvalidValueError(FLOWN_ON.format(episode.uid))
    rewards[-1] = 1.0
    return rewards
