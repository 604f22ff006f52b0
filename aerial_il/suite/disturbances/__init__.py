"""Disturbances, one file each: a module in this folder is registered by being there, see ``disturbance.py``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from aerial_il.core import registry

if TYPE_CHECKING:  # names are listed without importing a compiler
    from aerial_il.suite.disturbances.disturbance import Disturbance


def strengths(name: str) -> Mapping[str, Disturbance]:
    """Tier -> how strong a disturbance is there; tiers without it are missing."""
    return getattr(registry.module("disturbance", name), "TIERS", {})


def kernels(name: str) -> dict[str, Any]:
    """Hook -> compiled function, of those in :data:`hooks.NAMES` that a disturbance has.

    Raises:
        InvalidValueError: one of them is a plain Python function.
    """
    from aerial_il.suite.physics import hooks

    found = {hook: registry.kernel("disturbance", name, hook, needed=False) for hook in hooks.NAMES}
    return {hook: compiled for hook, compiled in found.items() if compiled is not None}
