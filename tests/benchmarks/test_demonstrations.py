"""Collecting demonstrations for a benchmark: as many as are wanted, and a failure costs one more flight."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from aerial_il.benchmarks.parts import demonstrations
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.folder import DEMOS

SOURCE = demonstrations.Source("fa_hexa_arm4", "reach", "calm", noise=0.0, seed=100, num_envs=4, threads=1)


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> tuple[set[int], set[int]]:
    """Seeds flown so far, and seeds to fail; a success leaves an empty file, nothing is simulated."""
    done: set[int] = set()
    failing: set[int] = set()

    def collect(env: Any, expert: Any, seeds: Iterable[int], out: Path, **_: Any) -> None:
        for seed in seeds:
            done.add(seed)
            if seed not in failing:
                (out / DEMOS).mkdir(parents=True, exist_ok=True)
                (out / DEMOS / f"{seed}.mcap").touch()

    monkeypatch.setattr(demonstrations, "collect", collect)
    monkeypatch.setattr(demonstrations.aerial_il, "load_batch", lambda *_, **__: SimpleNamespace(close=lambda: None))
    return done, failing


def test_a_failure_costs_one_more_flight(flown: tuple[set[int], set[int]], tmp_path: Path) -> None:
    done, failing = flown
    failing.update({103, 110})
    demonstrations.gather(SOURCE, tmp_path, 10, progress=False)
    assert done == set(range(100, 112))
    demonstrations.gather(SOURCE, tmp_path, 12, progress=False)
    assert max(done) == 113


def test_an_expert_that_always_fails_is_noticed(flown: tuple[set[int], set[int]], tmp_path: Path) -> None:
    flown[1].update(range(100, 200))
    with pytest.raises(InvalidValueError, match="fails too often"):
        demonstrations.gather(SOURCE, tmp_path, 10, progress=False)
