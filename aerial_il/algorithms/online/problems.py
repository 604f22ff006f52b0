"""What algorithms learn on: an environment's reward alone, or demonstrations of it as well."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar, Protocol

from aerial_il.algorithms.online.collector import RewardScheme
from aerial_il.algorithms.online.demonstrations import (
    Demonstrations,
    check_same,
    random_transitions,
    read_transitions,
)
from aerial_il.algorithms.online.interface import fit_interface, plain_interface
from aerial_il.algorithms.online.problem import Problem
from aerial_il.algorithms.online.rewarded_demonstrations import check_lengths, check_paid, with_rewards
from aerial_il.core.contracts import BatchEnv
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.parts.network import PolicySettings


class Demonstrated(Protocol):
    """What decides which demonstrations are learned from; where ``failures`` are learned from too it says so."""

    name: ClassVar[str]
    rewarded: ClassVar[bool]

    @property
    def demonstrations(self) -> Demonstrations: ...


def from_environment(name: str, policy: PolicySettings, env: BatchEnv, seed: int, scheme: RewardScheme) -> Problem:
    """Return a problem of the environment and its reward alone, for the algorithm ``name``."""
    interface = plain_interface(Layout.of(env.spec, policy), policy)
    return Problem(name, seed, policy, env, interface, scheme=scheme)


def from_demonstrations(
    settings: Demonstrated,
    dataset: Iterable[Episode] | None,
    policy: PolicySettings,
    env: BatchEnv,
    seed: int,
    *,
    scheme: RewardScheme | None = None,
    paid: bool = True,
) -> Problem:
    """Return a problem of demonstrations to imitate, or that are rewarded as the learner is, if it is ``rewarded``.

    In the control run ``random_actions`` flights at random take their place.

    Args:
        scheme: how steps are rewarded; None for the environment's reward.
        paid: whether the rewards that were recorded, or success, have to say something.

    Raises:
        InvalidValueError: there are none, or fewer than asked for; they come from another environment; they carry no
            reward that could be learned from, or are longer than episodes here.
    """
    which, scheme, episodes = settings.demonstrations, scheme or RewardScheme(), dataset or ()
    if settings.rewarded:
        episodes = list(episodes)
        check_lengths(episodes, env.spec)
        if paid and which.control == "none":
            check_paid(episodes, sparse=scheme.sparse)
        episodes = [with_rewards(episode, scheme, env) for episode in episodes]
    layout, demos, record = read_transitions(
        episodes,
        policy,
        trajectories=which.trajectories,
        subsample=which.subsample,
        labels=which.labels,
        rewarded=settings.rewarded,
        failures=getattr(settings, "failures", False),
        smoothness=scheme.smoothness,
        seed=seed,
    )
    check_same(layout.spec, env.spec)
    if which.control == "random_actions":
        demos = random_transitions(env, layout, len(demos.frames), seed=seed, scheme=scheme)
    interface = fit_interface(layout, demos.frames, demos.actions, policy=policy, bounds=which.bounds)
    return Problem(settings.name, seed, policy, env, interface, demos, record, scheme)
