"""The sampler tells which part of the code the time went to, compiled code included."""

import time
from types import FrameType

import numpy as np
import pytest

from experiments.rl_speed.sampling import INTERVAL_S, Place, Sampler

HERE = {"slow": [Place(__name__, "slow")], "outer": [Place(__name__, "outer")], "other": [Place("elsewhere")]}


def busy(seconds: float) -> None:
    """Work for so many seconds of the processor, whatever else it does."""
    started = time.process_time()
    while time.process_time() - started < seconds:
        sum(range(100))


def slow() -> None:
    busy(0.06)


def outer() -> None:
    busy(0.03)
    slow()


def test_time_belongs_to_the_innermost_section() -> None:
    with Sampler(HERE, rest="rest", clock=time.process_time) as sampler:
        outer()
        busy(0.03)
    result, total = sampler.seconds, sum(sampler.seconds.values())
    assert list(result) == ["slow", "outer", "other", "rest"]
    assert result["other"] == 0.0
    assert result["slow"] > result["outer"] > 0.1 * total
    assert result["rest"] > 0.1 * total


def test_compiled_code_counts_for_who_called_it() -> None:
    def slow() -> None:
        np.linalg.eigh(np.eye(700))

    with Sampler(HERE, rest="rest", clock=time.process_time) as sampler:
        slow()
    assert sampler.seconds["slow"] > 0.5 * sum(sampler.seconds.values())


def test_a_busy_machine_piles_up_no_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    depth, deepest = 0, 0
    taken = Sampler._section

    def late(self: Sampler, frame: FrameType | None) -> str:
        nonlocal depth, deepest
        depth += 1
        deepest = max(deepest, depth)
        busy(3 * INTERVAL_S)
        depth -= 1
        return taken(self, frame)

    monkeypatch.setattr(Sampler, "_section", late)
    with Sampler(HERE, rest="rest", clock=time.process_time) as sampler:
        slow()
    assert deepest == 1
    assert sampler.seconds["slow"] > 0.5 * sum(sampler.seconds.values())
