"""One look for all progress bars of benchmarks."""

from __future__ import annotations

from collections.abc import Iterable

from aerial_il.core.progress import Progress


def bar[T](items: Iterable[T], name: str, progress: bool) -> Iterable[T]:
    """Iterate over ``items`` with a progress bar on stderr, or without one."""
    return Progress(items, desc=f"bench {name}", unit="arm", disable=not progress)
