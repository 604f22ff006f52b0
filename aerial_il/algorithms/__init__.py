"""Learning algorithms: one file each, its settings in it; what several share lies in the subpackages."""

from __future__ import annotations

from typing import TYPE_CHECKING

from aerial_il.core import registry

if TYPE_CHECKING:  # numpy comes with it, which help and completion do without
    from aerial_il.core.contracts import Algorithm


def names() -> tuple[str, ...]:
    """Return the names of all algorithms, without importing them."""
    return registry.names("algorithm")


def get(name: str) -> type[Algorithm]:
    """Return the class that holds the settings of the algorithm ``name`` and trains by them.

    Raises:
        UnknownNameError: no algorithm has that name.
    """
    return registry.get("algorithm", name)
