"""The narrow link of the benchmarks."""

from __future__ import annotations

from aerial_il.benchmarks.parts.teleop.narrow import narrowed

__all__ = ["narrowed"]
