"""What a run learns on: the environment alone, a prior's weights in it, or demonstrations of it."""

from __future__ import annotations

from collections.abc import Iterable

from aerial_il.algorithms.off_policy.settings import Demonstrations, Prior
from aerial_il.algorithms.rl.collector import RewardScheme
from aerial_il.algorithms.rl.demonstrated import MEANT, check_lengths, check_paid, rewarded_by, with_rewards
from aerial_il.algorithms.rl.from_prior import check_weights, explored
from aerial_il.algorithms.rl.interface import fit_interface, plain_interface
from aerial_il.algorithms.rl.online_run import Problem
from aerial_il.algorithms.rl.replay.demonstrations import check_same, random_transitions, read_transitions
from aerial_il.algorithms.rl.replay.hindsight import Hindsight, goal_columns
from aerial_il.algorithms.run.prior import load_prior
from aerial_il.core.checkpoint import digest
from aerial_il.core.contracts import BatchEnv
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.parts.network import PolicySettings

OWN_NORM = "A prior brings its own normalisation of observations: set algorithm.obs_norm=false."


def from_reward(
    name: str,
    policy: PolicySettings,
    env: BatchEnv,
    seed: int,
    scheme: RewardScheme,
    *,
    prior: Prior | None,
    norm: bool,
) -> Problem:
    """Return a problem of the reward alone; with a ``prior``, through that policy's interface."""
    if prior is None:
        return Problem(name, seed, policy, env, plain_interface(Layout.of(env.spec, policy), policy), scheme=scheme)
    begun = load_prior(prior.path, env.spec)
    check_weights(begun, policy, prior.path)
    if norm:
        raise InvalidValueError(OWN_NORM)
    inputs, weights = {"prior": digest(begun.to_checkpoint())}, begun.network.state_dict()
    return Problem(name, seed, policy, env, explored(begun.interface), scheme=scheme, inputs=inputs, initial=weights)


def from_demonstrations(
    name: str,
    policy: PolicySettings,
    env: BatchEnv,
    seed: int,
    scheme: RewardScheme,
    *,
    dataset: Iterable[Episode] | None,
    which: Demonstrations,
    hindsight: Hindsight,
) -> Problem:
    """Return a problem with demonstrations, rewarded as the learner is."""
    if which.labels == "expert":
        raise InvalidValueError(MEANT)
    episodes = list(dataset or ())
    check_lengths(episodes, env.spec)
    if which.control == "none" and not hindsight.goals:
        check_paid(episodes, sparse=scheme.sparse)
    layout, demos, record = read_transitions(
        [with_rewards(episode, scheme, env) for episode in episodes],
        policy,
        trajectories=which.trajectories,
        subsample=which.subsample,
        labels=which.labels,
        rewarded=True,
        failures=which.failures,
        smoothness=scheme.smoothness,
        seed=seed,
    )
    check_same(layout.spec, env.spec)
    if which.control == "random_actions":
        demos = random_transitions(env, layout, len(demos.frames), seed=seed, scheme=scheme)
    interface = fit_interface(layout, demos.frames, demos.actions, policy=policy, bounds=which.bounds)
    if hindsight.goals:
        demos = rewarded_by(goal_columns(env, interface.layout), demos, tolerance=hindsight.tolerance)
    return Problem(name, seed, policy, env, interface, demos, record, scheme)
