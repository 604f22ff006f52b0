"""Filtered cloning keeps what succeeded, as it was flown, and nothing else."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.filtered_bc import FilteredBC
from aerial_il.algorithms.run.prior import load_prior
from aerial_il.collection.collect import collect
from aerial_il.core.checkpoint import ARRAYS
from aerial_il.core.errors import CheckpointError, InvalidValueError, NoRewardError
from aerial_il.policies import load_policy
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms.drift import SPEC, Drift, Silent, demonstrations
from tests.algorithms.train_rounds import flights_of

DEMOS = 3
FEW = BC(steps=40, batch_size=32, warmup_steps=5, ema=0.9, validation=0.0, validate_every=0)


POLICY = SquashedGaussian(hidden=(16,))


def trained(run: Path, *, seed: int = 3, policy: PolicySettings = POLICY, env: Any = None, **settings: Any) -> Path:
    algorithm = FilteredBC(**{"training": FEW, "between_steps": 20, "rounds": 2, "episodes": 8, **settings})
    options = {"env": env or Drift(8), "collect": collect, "seed": seed, "progress": False}
    algorithm.train(demonstrations(DEMOS), policy, run=run, **options)
    return run


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return trained(tmp_path_factory.mktemp("filtered") / "run")


def test_what_was_flown_is_the_label_and_nobody_is_asked(whole: Path) -> None:
    for flight in flights_of(whole, 1):
        assert not flight.asked.any()
        np.testing.assert_array_equal(flight.labels, flight.executed_actions)


def test_only_successes_are_learned_from(whole: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    seen: list[list[bool]] = []
    train = BC.train

    def watched(self: BC, dataset: Any, *args: Any, **options: Any) -> Any:
        seen.append([episode.success for episode in dataset])
        return train(self, dataset, *args, **options)

    monkeypatch.setattr(BC, "train", watched)
    run = trained(tmp_path / "watched")
    won = [sum(flight.success for flight in flights_of(run, number)) for number in (1, 2)]
    assert 0 < sum(won) < 16, "a check that no flight fails or succeeds would tell nothing"
    assert [len(one) for one in seen] == [DEMOS, DEMOS + won[0], DEMOS + sum(won)]
    assert all(all(one) for one in seen)


def test_noise_moves_what_is_flown(whole: Path, tmp_path: Path) -> None:
    calm = trained(tmp_path / "calm", noise=0.0)
    pairs = zip(flights_of(whole, 1), flights_of(calm, 1), strict=True)
    assert any(len(a) != len(b) or not np.array_equal(a.executed_actions, b.executed_actions) for a, b in pairs)


def test_a_prior_of_another_class_flies_the_first_round(whole: Path, tmp_path: Path) -> None:
    chunked = MLP(hidden=(16,), chunk=3, execute=3, ensemble=None, anchor=None, masked_fields=())
    prior = trained(tmp_path / "prior", policy=chunked, rounds=1)
    led = trained(tmp_path / "led", prior=str(prior))
    assert load_policy(led).config == POLICY
    for one, other in zip(flights_of(led, 1), flights_of(whole, 1), strict=True):
        assert not np.array_equal(one.actions, other.actions), "the clone flew, not the prior"


def test_another_prior_in_the_same_place_is_another_run(tmp_path: Path) -> None:
    prior = trained(tmp_path / "prior", rounds=1)
    settings = {"prior": str(prior), "rounds": 1}
    trained(tmp_path / "run", **settings)
    before = (tmp_path / "run" / "policy" / ARRAYS).read_bytes()
    trained(tmp_path / "run", **settings)
    assert (tmp_path / "run" / "policy" / ARRAYS).read_bytes() == before
    shutil.rmtree(prior)
    trained(prior, rounds=1, seed=5)
    with pytest.raises(InvalidValueError, match="holds another run"):
        trained(tmp_path / "run", **settings)


def test_a_prior_that_cannot_fly_here_is_refused_before_flights_of(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="does not exist"):
        trained(tmp_path / "run", prior=str(tmp_path / "nowhere"))
    prior = load_policy(trained(tmp_path / "prior", rounds=1))
    action = replace(SPEC.action, level="force", labels=("x",), units=("N",))
    with pytest.raises(InvalidValueError, match=r"cannot fly here.*force actions: algorithm.prior=RUN"):
        load_prior(str(tmp_path / "prior"), replace(prior.spec, action=action))
    assert not (tmp_path / "run" / "rounds").exists()


def test_flights_that_never_succeed_end_the_run(tmp_path: Path) -> None:
    with pytest.raises(NoRewardError):
        trained(tmp_path / "run", env=Silent(8), reward_patience=50)
    trained(tmp_path / "patient", env=Silent(8), reward_patience=0)
