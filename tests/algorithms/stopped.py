"""Trainings that are stopped: called again, each ends with the same bytes as if nothing had happened."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from aerial_il.core.checkpoint import ARRAYS


def bytes_of(run: Path) -> bytes:
    """Return the weights of a run's finished policy as they lie on disk."""
    return (run / "policy" / ARRAYS).read_bytes()


def nothing(policy: Any, step: int) -> dict[str, float]:
    """Judge without a number."""
    return {}


def assert_same_when_stopped(train: Callable[..., object], home: Path, *stops: int) -> None:
    """Train undisturbed, and stopped in the first evaluation from each of the ``stops`` on; require equal weights.

    Args:
        train: gets the run's folder, and ``evaluate``.
    """
    train(home / "whole", evaluate=nothing)
    for stop in stops:

        def stopped(policy: Any, step: int, stop: int = stop) -> dict[str, float]:
            if step >= stop:
                raise KeyboardInterrupt
            return {}

        with pytest.raises(KeyboardInterrupt):
            train(home / "run", evaluate=stopped)
    train(home / "run", evaluate=nothing)
    assert bytes_of(home / "run") == bytes_of(home / "whole")
