"""A prior whose weights an actor starts from: which ones fit, and how its actions are explored around."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.parts.normaliser import MIN_SCALE


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
    theirs, ours = ({"policy": config.name, **config.to_dict()} for config in (prior.config, policy))
    differing = sorted(key for key in theirs.keys() | ours.keys() if theirs.get(key) != ours.get(key))
    if type(prior) is not ChunkPolicy:
        raise InvalidValueError(
            f"The prior {source} stands beside another one: an actor cannot begin with its weights."
        )
    if differing:
        changes = "; ".join(f"{key}: {theirs.get(key)!r} there, {ours.get(key)!r} here" for key in differing)
        hint = "Say policy=... as it was trained, or take algorithm=ibrl, which any class can lead."
        raise InvalidValueError(f"An actor cannot begin with the weights of the prior {source} ({changes}). {hint}")
