"""Fixtures that numbers and pages share."""

from tests.evaluation.flights import diver, expert, flown, skip_without_rendering

__all__ = ["diver", "expert", "flown", "skip_without_rendering"]
