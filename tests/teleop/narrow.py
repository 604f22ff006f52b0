"""The narrow link of the study of teleoperation."""

from __future__ import annotations

from experiments.teleop.narrow import narrowed

__all__ = ["narrowed"]
