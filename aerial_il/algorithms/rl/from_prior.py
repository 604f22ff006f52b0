"""Settings of actor-critics whose actor may be initialised from a trained policy; critics learn its value first."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from aerial_il.algorithms.rl.online_run import Problem
from aerial_il.algorithms.rl.reinforcement import OffPolicyReinforcement
from aerial_il.algorithms.run.prior import load_prior
from aerial_il.core.checkpoint import digest
from aerial_il.core.contracts import BatchEnv
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.parts.normaliser import MIN_SCALE


@dataclass(frozen=True, kw_only=True)
class BegunFromPrior(OffPolicyReinforcement):
    """Settings of these actor-critics.

    Attributes:
        prior: a run or policy of the same class and sizes, from whose weights the actor starts; None for random ones.
            It flies through the warm-up in place of random actions, while the critics alone learn its value.
    """

    prior: str | None = None

    def problem(self, dataset: Iterable[Episode] | None, policy: PolicySettings, env: BatchEnv, seed: int) -> Problem:
        """Return what is learned on; with a prior, through that policy's interface.

        Raises:
            InvalidValueError: the prior cannot fly here, or its weights are none of this policy's.
        """
        if self.prior is None:
            return super().problem(dataset, policy, env, seed)
        begun = load_prior(self.prior, env.spec)
        check_weights(begun, policy, self.prior)
        if self.obs_norm:
            raise InvalidValueError(
                "A prior brings its own normalisation of observations: set algorithm.obs_norm=false."
            )
        return Problem(
            self.name,
            seed,
            policy,
            env,
            explored(begun.interface),
            scheme=self.scheme,
            inputs={"prior": digest(begun.to_checkpoint())},
            initial=begun.network.state_dict(),
        )


def explored(interface: Interface) -> Interface:
    """Return a prior's interface with the action elements held that its demonstrations never varied.

    They have no spread that exploration could be measured in: ±1 would be a metre or a radian. What is counted from the
    end effector is no fixed value that could be held: it gets the spread below which an element counts as constant.
    """
    action, moving = interface.action, interface.layout.moving
    switches = interface.switches.holding(interface.constant & ~moving, action.centre)
    scale = np.where(interface.constant & moving, np.float32(MIN_SCALE), action.scale)
    return replace(interface, action=replace(action, scale=scale), switches=switches)


def check_weights(prior: ChunkPolicy, policy: PolicySettings, source: str) -> None:
    """Raise :class:`InvalidValueError` unless the network of ``prior`` is one that ``policy`` builds."""
    found, wanted = ({"policy": config.name, **config.to_dict()} for config in (prior.config, policy))
    differing = sorted(key for key in found.keys() | wanted.keys() if found.get(key) != wanted.get(key))
    if type(prior) is not ChunkPolicy:
        raise InvalidValueError(
            f"The prior {source} stands beside another one: an actor cannot begin with its weights."
        )
    if differing:
        changes = "; ".join(f"{key}: {found.get(key)!r} there, {wanted.get(key)!r} here" for key in differing)
        hint = "Say policy=... as it was trained, or take algorithm=ibrl, which any class can lead."
        raise InvalidValueError(f"An actor cannot begin with the weights of the prior {source} ({changes}). {hint}")
