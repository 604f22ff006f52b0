"""What a policy with eyes is deprived of when it flies: its images, a camera, looks, or what it knew before.

All keep the networks as they were trained: what is lost is lost in flight.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from torch import nn

from aerial_il.core.contracts import BatchEnv, Observation, Policy, attach
from aerial_il.policies.perception.eyes import Eyes
from aerial_il.policies.perception.policy import PerceivingPolicy

BLANK, FROZEN = "images blanked", "first frame for ever"
NOTHING_KEPT = 1e-9


class Misled(Policy):
    """A policy that is shown other images than there are: black ones, or those of the first step for ever."""

    def __init__(self, policy: Policy, images: Sequence[str], *, frozen: bool) -> None:
        self._policy, self._images, self._frozen = policy, tuple(images), frozen
        self._first: dict[str, np.ndarray] = {}
        self._begins: np.ndarray | None = None

    def act(self, obs: Observation) -> np.ndarray:
        return self._policy.act({**obs, **{name: self._shown(name, obs[name]) for name in self._images}})

    def reset(self, mask: np.ndarray | None = None) -> None:
        self._policy.reset(mask)
        if mask is None:
            self._first.clear()
        self._begins = mask

    def attach(self, env: BatchEnv) -> None:
        attach(self._policy, env)

    def _shown(self, name: str, images: np.ndarray) -> np.ndarray:
        if not self._frozen:
            return np.zeros_like(images)
        first = self._first.setdefault(name, images.copy())
        if self._begins is not None:
            first[self._begins] = images[self._begins]
            self._begins = None if name == self._images[-1] else self._begins
        return first


def deprived(
    policy: PerceivingPolicy, *, camera: int | None = None, every: int | None = None, forget: float | None = None
) -> PerceivingPolicy:
    """Return a policy that looks through one ``camera`` alone, at another rate, or keeps less of what it knew."""
    kept = policy.eyes if camera is None else _one_of(policy.eyes, camera)
    every, forget = every or policy.every, forget or policy.forget
    return PerceivingPolicy(policy.pilot, kept, every=every, forget=forget, origin=policy.origin)


def _one_of(eyes: Eyes, camera: int) -> Eyes:
    one = Eyes(eyes.targets, eyes.cameras[camera : camera + 1], [eyes.sizes[camera]], eyes.own, eyes.knows, eyes.width)
    one.eyes = nn.ModuleList([eyes.eyes[camera]])
    return one


CONTROLS = (BLANK, FROZEN)  # of any policy that looks
DEPRIVED: Mapping[str, Callable[[PerceivingPolicy], PerceivingPolicy]] = {
    "first camera alone": partial(deprived, camera=0),
    "second camera alone": partial(deprived, camera=1),
    "10 Hz": partial(deprived, every=5),
    "the last look alone": partial(deprived, forget=NOTHING_KEPT),
}
CHANGES = (*CONTROLS, *DEPRIVED)


def changed(policy: Policy, change: str, images: Sequence[str]) -> Policy:
    """Return a policy that looks at ``images``, deprived as ``change``, one of ``CHANGES``, says."""
    if change in CONTROLS:
        return Misled(policy, images, frozen=change == FROZEN)
    assert isinstance(policy, PerceivingPolicy)
    return DEPRIVED[change](policy)
