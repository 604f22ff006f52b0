"""Filtered cloning keeps what succeeded, as it was flown, and nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il.algorithms.bc import BehaviourCloning
from aerial_il.algorithms.filtered_bc import FilteredCloning
from aerial_il.collection.collect import collect
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from aerial_il.policies.squashed_gaussian import SquashedGaussianConfig
from tests.algorithms.drift import Drift, demonstrations

DEMOS = 3
FEW = BehaviourCloning(steps=40, batch_size=32, warmup_steps=5, ema=0.9, validation=0.0, validate_every=0)


def trained(run: Path, **settings: Any) -> Path:
    algorithm = FilteredCloning(training=FEW, between_steps=20, rounds=2, episodes=8, **settings)
    policy = SquashedGaussianConfig(hidden=(16,))
    env: Any = Drift(8)
    algorithm.train(demonstrations(DEMOS), policy, run=run, env=env, collect=collect, seed=3, progress=False)
    return run


def flights(run: Path, number: int) -> list[Episode]:
    return list(open_dataset(run / "rounds" / f"{number:03d}" / "flights", failures=True))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return trained(tmp_path_factory.mktemp("filtered") / "run")


def test_what_was_flown_is_the_label_and_nobody_is_asked(whole: Path) -> None:
    for flight in flights(whole, 1):
        assert not flight.asked.any()
        np.testing.assert_array_equal(flight.labels, flight.executed_actions)


def test_only_successes_are_learned_from(whole: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    seen: list[list[bool]] = []
    train = BehaviourCloning.train

    def watched(self: BehaviourCloning, dataset: Any, *args: Any, **options: Any) -> Any:
        seen.append([episode.success for episode in dataset])
        return train(self, dataset, *args, **options)

    monkeypatch.setattr(BehaviourCloning, "train", watched)
    run = trained(tmp_path / "watched")
    won = [sum(flight.success for flight in flights(run, number)) for number in (1, 2)]
    assert 0 < sum(won) < 16, "a check that no flight fails or succeeds would tell nothing"
    assert [len(one) for one in seen] == [DEMOS, DEMOS + won[0], DEMOS + sum(won)]
    assert all(all(one) for one in seen)


def test_noise_moves_what_is_flown(whole: Path, tmp_path: Path) -> None:
    calm = trained(tmp_path / "calm", noise=0.0)
    pairs = zip(flights(whole, 1), flights(calm, 1), strict=True)
    assert any(len(a) != len(b) or not np.array_equal(a.executed_actions, b.executed_actions) for a, b in pairs)
