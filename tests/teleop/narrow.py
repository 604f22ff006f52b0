"""The narrow link of the benchmarks."""

from __future__ import annotations

from experiments.teleop.narrow import narrowed

__all__ = ["narrowed"]
