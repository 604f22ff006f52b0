"""What anything that acts must offer: experts, people, networks and random ones alike."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np

Observation = Mapping[str, np.ndarray]


@runtime_checkable
class Policy(Protocol):
    """Maps observations of n worlds to n actions."""

    def act(self, obs: Observation) -> np.ndarray:
        """Return actions (n, Da) in the environment's units for observations ``name -> (n, ...)``."""
        ...

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the memory of the worlds in ``mask`` (n,) bool, or of all of them."""
        ...


@runtime_checkable
class PrivilegedPolicy(Policy, Protocol):
    """A policy that also reads the simulator, such as a scripted expert."""

    def attach(self, env: Any) -> None:
        """Bind to the batch or single environment that it will act in."""
        ...


def attach(policy: Policy, env: Any) -> Policy:
    """Attach ``policy`` to ``env`` if it reads the simulator; return it either way."""
    if isinstance(policy, PrivilegedPolicy):
        policy.attach(env)
    return policy


@runtime_checkable
class SeededPolicy(Policy, Protocol):
    """A policy that rolls dice: given the episodes' seeds, what it does in one does not depend on the others."""

    def begin(self, seeds: np.ndarray, mask: np.ndarray | None = None) -> None:
        """Learn the seeds (n,) of the episodes that begin in the worlds of ``mask`` (n,) bool, or in all of them."""
        ...
