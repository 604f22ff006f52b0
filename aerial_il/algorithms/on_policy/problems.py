"""What on-policy algorithms learn on that start from nothing: the environment and its reward."""

from __future__ import annotations

from typing import ClassVar, Protocol

from aerial_il.algorithms.on_policy.settings import Rollout
from aerial_il.algorithms.online.problem import Problem, check_steps, whole_turns
from aerial_il.algorithms.online.problems import from_environment
from aerial_il.algorithms.online.rewards import Rewarded, reward_scheme
from aerial_il.core.contracts import BatchEnv
from aerial_il.policies.parts.network import PolicySettings


class Settings(Rewarded, Protocol):
    """What decides on what is learned."""

    name: ClassVar[str]

    @property
    def rollout(self) -> Rollout: ...


def from_reward(settings: Settings, policy: PolicySettings, env: BatchEnv, seed: int, *, fades: bool = True) -> Problem:
    """Return a problem of the reward alone.

    Args:
        fades: whether the learning rate falls to zero, so that a rollout which is the last one teaches nothing.

    Raises:
        InvalidValueError: the first rollout would be the last one.
    """
    if fades:
        check_steps(settings, "rollout.steps", whole_turns(settings.rollout.steps, env.num_envs))
    return from_environment(settings.name, policy, env, seed, reward_scheme(settings))
