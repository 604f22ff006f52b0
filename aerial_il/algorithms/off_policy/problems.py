"""What off-policy algorithms learn on: the environment alone, a prior's weights in it, or demonstrations of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import ClassVar, Protocol

from aerial_il.algorithms.off_policy import loop
from aerial_il.algorithms.off_policy.from_prior import check_weights, explored
from aerial_il.algorithms.off_policy.hindsight import Hindsight, goal_columns
from aerial_il.algorithms.online import problems
from aerial_il.algorithms.online.collector import RewardScheme
from aerial_il.algorithms.online.problem import Problem, check_steps, whole_turns
from aerial_il.algorithms.online.rewarded_demonstrations import rewarded_by
from aerial_il.algorithms.online.rewards import Rewarded, reward_scheme
from aerial_il.algorithms.run.prior import load_prior
from aerial_il.core.checkpoint import digest
from aerial_il.core.contracts import BatchEnv
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.network import PolicySettings

OWN_NORM = "A prior brings its own normalisation of observations: set algorithm.obs_norm=false."


class Relabelled(loop.Settings, Rewarded, Protocol):
    """Settings of those that are rewarded, in hindsight for other goals too."""

    name: ClassVar[str]

    @property
    def hindsight(self) -> Hindsight: ...


class StartedFromPrior(Relabelled, Protocol):
    """Settings of those that may start from a prior's weights, too."""

    @property
    def prior(self) -> str | None: ...
    @property
    def obs_norm(self) -> bool: ...


class RelabelledDemonstrated(problems.Demonstrated, Relabelled, Protocol):
    """Settings of those that are shown demonstrations as well."""


def check_warmup(settings: loop.Settings, env: BatchEnv) -> None:
    """Raise :class:`InvalidValueError` where a run in ``env`` would end before its policy learns."""
    last = 0 if settings.lr_floor else env.num_envs  # the last turn, where no learning rate is left
    check_steps(settings, "warmup", whole_turns(settings.warmup, env.num_envs) + last)


def from_reward(settings: Relabelled, policy: PolicySettings, env: BatchEnv, seed: int) -> Problem:
    """Return a problem of the reward alone.

    Raises:
        InvalidValueError: the run would end before its policy learns.
    """
    check_warmup(settings, env)
    return problems.from_environment(settings.name, policy, env, seed, relabelled_scheme(settings))


def from_reward_or_prior(settings: StartedFromPrior, policy: PolicySettings, env: BatchEnv, seed: int) -> Problem:
    """Return a problem of the reward alone; with a prior, through that policy's interface and from its weights.

    Raises:
        InvalidValueError: also where the prior cannot fly here, or its weights are none of this policy's.
    """
    if settings.prior is None:
        return from_reward(settings, policy, env, seed)
    check_warmup(settings, env)
    prior = load_prior(settings.prior, env.spec)
    check_weights(prior, policy, settings.prior)
    if settings.obs_norm:
        raise InvalidValueError(OWN_NORM)
    return Problem(
        settings.name,
        seed,
        policy,
        env,
        explored(prior.interface),
        scheme=relabelled_scheme(settings),
        inputs={"prior": digest(prior.to_checkpoint())},
        initial=prior.network.state_dict(),
    )


def from_demonstrations(
    settings: RelabelledDemonstrated,
    dataset: Iterable[Episode] | None,
    policy: PolicySettings,
    env: BatchEnv,
    seed: int,
) -> Problem:
    """Return a problem of demonstrations, rewarded as the learner is; with hindsight, by the rule of their goals.

    Raises:
        InvalidValueError: see :func:`problems.from_demonstrations`; or hindsight finds no goal that it could exchange.
    """
    goals, scheme = settings.hindsight.goals, relabelled_scheme(settings)
    problem = problems.from_demonstrations(settings, dataset, policy, env, seed, scheme=scheme, paid=goals == 0)
    if not goals or problem.demos is None:
        return problem
    goal = goal_columns(env, problem.interface.layout)
    return replace(problem, demos=rewarded_by(goal, problem.demos, tolerance=settings.hindsight.tolerance))


def relabelled_scheme(settings: Relabelled) -> RewardScheme:
    """Return how steps are rewarded, with hindsight among the ways out where none comes."""
    if settings.hindsight.goals:
        return reward_scheme(settings)
    also = " algorithm.reward=environment" if settings.reward == "sparse" else ""
    return reward_scheme(settings, f"hindsight, where the task exposes a goal (algorithm.hindsight.goals=4{also})")
