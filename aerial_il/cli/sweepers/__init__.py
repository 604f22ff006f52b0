"""Sweepers, one file each: which points of a space are tried next. Without one a sweep tries every combination.

A sweeper is a dataclass of settings, ``sweeper.KEY=VALUE``, with a method ``search``.
"""

from __future__ import annotations

import pkgutil


def names() -> tuple[str, ...]:
    """Names of all sweepers, without importing them."""
    return tuple(sorted(module.name for module in pkgutil.iter_modules(__path__)))
