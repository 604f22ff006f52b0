"""What off-policy algorithms learn on: the environment alone, a prior's weights in it, or demonstrations of it."""

from dataclasses import replace

import numpy as np

from aerial_il.algorithms.off_policy.hindsight import goal_columns
from aerial_il.algorithms.online import problem
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.problem import Given, Problem, check_steps, reward_scheme, whole_turns
from aerial_il.algorithms.online.rewarded_demonstrations import rewarded_by
from aerial_il.algorithms.run.prior import load_prior
from aerial_il.core.checkpoint import digest
from aerial_il.core.contracts import BatchEnv
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.parts.normaliser import HARDLY

OWN_NORM = "A prior brings its own normalisation of observations: set algorithm.obs_norm=false."


def check_warmup(settings: Algorithm, env: BatchEnv) -> None:
    """Raise :class:`InvalidValueError` where a run in ``env`` would end before its policy learns."""
    last = 0 if settings.lr_floor else env.num_envs  # the last turn, where no learning rate is left
    check_steps(settings, "warmup", whole_turns(settings.warmup, env.num_envs) + last)


def from_reward_or_prior(settings: Algorithm, given: Given) -> Problem:
    """Return a problem of the reward alone; with a prior, through that policy's interface and from its weights.

    Raises:
        InvalidValueError: the run would end before its policy learns; the prior cannot fly here, or its weights are
            none of this policy's.
    """
    check_warmup(settings, given.env)
    source: str | None = getattr(settings, "prior", None)
    if source is None:
        return problem.from_reward(settings, given)
    prior = load_prior(source, given.env.spec, alone=True)
    check_weights(prior, given.policy, source)
    if settings.obs_norm:
        raise InvalidValueError(OWN_NORM)
    return Problem(
        settings.name,
        given.seed,
        given.policy,
        given.env,
        explored(prior.interface),
        scheme=reward_scheme(settings),
        inputs={"prior": digest(prior.to_checkpoint())},
        initial=prior.network.state_dict(),
    )


def from_demonstrations(settings: Algorithm, given: Given) -> Problem:
    """Return a problem of demonstrations, rewarded as the learner is; with hindsight, by the rule of their goals.

    Raises:
        InvalidValueError: see :func:`problem.from_demonstrations`; or hindsight finds no goal that it could exchange;
            or the run would end before a policy that learned nothing before its flights does.
    """
    if not getattr(settings, "offline_steps", 0):
        check_warmup(settings, given.env)
    goals = settings.hindsight.goals
    shown = problem.from_demonstrations(settings, given, paid=goals == 0)
    if not goals or shown.demos is None:
        return shown
    goal = goal_columns(given.env, shown.interface.layout)
    return replace(shown, demos=rewarded_by(goal, shown.demos, tolerance=settings.hindsight.tolerance))


def explored(interface: Interface) -> Interface:
    """Return a prior's interface with the action elements held that its demonstrations never varied.

    They have no spread that exploration could be measured in: ±1 would be a metre or a radian. What is counted from the
    end effector is no fixed value that could be held: it gets the spread below which an element counts as constant.
    """
    action, moving = interface.action, interface.layout.moving
    switches = interface.switches.holding(interface.constant & ~moving, action.centre)
    reach = interface.layout.spec.action.reach
    held = interface.constant & moving
    scale = np.where(held, np.where(np.isfinite(reach), HARDLY * reach, HARDLY), action.scale).astype(np.float32)
    return replace(interface, action=replace(action, scale=scale), switches=switches)


def check_weights(prior: ChunkPolicy, policy: PolicySettings, source: str) -> None:
    """Raise :class:`InvalidValueError` unless the network of ``prior`` is one that ``policy`` builds."""
    theirs, ours = ({"policy": config.name, **config.to_dict()} for config in (prior.config, policy))
    differing = sorted(key for key in theirs.keys() | ours.keys() if theirs.get(key) != ours.get(key))
    if type(prior) is not ChunkPolicy:
        raise InvalidValueError(
            f"The prior {source} stands beside another one: an actor cannot start with its weights."
        )
    if differing:
        changes = "; ".join(f"{key}: {theirs.get(key)!r} there, {ours.get(key)!r} here" for key in differing)
        hint = "Say policy=... as it was trained, or take algorithm=ibrl, which any class can lead."
        raise InvalidValueError(f"An actor cannot start with the weights of the prior {source} ({changes}). {hint}")
