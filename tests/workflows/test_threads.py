"""What a command is told of threads reaches environments from outside as processes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import aerial_il
from aerial_il.algorithms.dac import DAC
from aerial_il.collection.collect import collect
from aerial_il.evaluation.baselines import Random
from aerial_il.suite import outside
from aerial_il.workflows.parts import pilots, training_resources


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Among how many processes worlds were asked to be shared; they are made in one."""
    found: list[int] = []
    load = outside.load

    def noted(key: str, *, processes: int = 1, **options: Any) -> Any:
        found.append(processes)
        return load(key, **options)

    monkeypatch.setattr(outside, "load", noted)
    return found


def test_of_a_pilot(asked: list[int]) -> None:
    pilot = pilots.pilot("random", robot=None, task=None, action=None, env="gymnasium:Pendulum-v1")
    for threads, num_envs in ((2, 16), (2, 15), (1, 16)):
        pilot.environment("calm", num_envs=num_envs, threads=threads).close()
    assert asked == [2, 1, 1]


def test_of_a_training_that_flies(asked: list[int], tmp_path: Path) -> None:
    env = aerial_il.load_gymnasium("Pendulum-v1", num_envs=1, max_steps=5)
    collect(env, Random(), range(1), tmp_path, policy_name="random", settings={}, progress=False)
    asked.clear()
    where = {"images": (), "expert": None, "tier": None, "num_envs": 24, "threads": 3}
    with training_resources.training_resources(DAC(), str(tmp_path), **where) as handed:
        assert handed["env"].num_envs == 24
    assert asked == [3]
