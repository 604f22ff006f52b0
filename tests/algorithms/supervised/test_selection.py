"""Demonstrations are chosen and weighted by who flew them and how well."""

from dataclasses import replace

import numpy as np
import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.supervised.selection import roughness
from aerial_il.algorithms.supervised.training_set import Shuffle, cut_windows, digest_of, read_demos, window_weights
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.data.episode import Episode
from aerial_il.policies.mlp import MLP
from tests.algorithms.point_mass import demonstrations

EVERYONE = BC.selection


@pytest.fixture(scope="module")
def demos() -> list[Episode]:
    """Six flights, the odd ones by a person."""
    flown = demonstrations(6)
    names = ["expert", "person"] * 3
    return [replace(d, provenance={**d.provenance, "policy": n}) for d, n in zip(flown, names, strict=True)]


def uids(demos: list[Episode]) -> list[str]:
    return [demo.uid for demo in demos]


def test_everyone_counts_alike_unless_something_is_said(demos: list[Episode]) -> None:
    kept, weights = EVERYONE.apply(demos)
    assert uids(kept) == uids(demos)
    assert (weights == 1).all()


def test_only_some_operators_are_learned_from(demos: list[Episode]) -> None:
    kept, _ = replace(EVERYONE, operators=("person",)).apply(demos)
    assert uids(kept) == ["demo-1", "demo-3", "demo-5"]
    with pytest.raises(UnknownNameError, match=r"operator 'persn'.*person"):
        replace(EVERYONE, operators=("persn",)).apply(demos)


def test_the_better_half_is_kept_in_its_order(demos: list[Episode]) -> None:
    kept, _ = replace(EVERYONE, keep=0.5, quality="duration").apply(demos)
    assert len(kept) == 3
    assert max(map(len, kept)) <= min(len(d) for d in demos if d.uid not in uids(kept))
    assert uids(kept) == sorted(uids(kept))
    rough = [
        replace(d, executed_actions=d.executed_actions + 0.1 * (-1.0) ** np.arange(len(d))[:, None]) for d in demos
    ]
    assert all(roughness(a) > roughness(b) for a, b in zip(rough, demos, strict=True))
    kept, _ = replace(EVERYONE, keep=0.5, quality="smoothness").apply([*rough[:3], *demos[3:]])
    assert uids(kept) == ["demo-3", "demo-4", "demo-5"]
    good = [replace(d, rewards=np.full(len(d), 0.1 * k)) for k, d in enumerate(demos)]
    assert uids(replace(EVERYONE, keep=0.1, quality="reward").apply(good)[0]) == ["demo-5"]


def test_failures_are_not_better_for_being_short(demos: list[Episode]) -> None:
    failed = {min(demos, key=len).uid, demos[0].uid}
    flown = [replace(d, success=d.uid not in failed) for d in demos]
    kept, weights = replace(EVERYONE, failures=1.0, sharpness=2.0, quality="duration").apply(flown)
    assert {d.uid for d, w in zip(kept, weights, strict=True) if w in sorted(weights)[:2]} == failed
    kept, _ = replace(EVERYONE, failures=1.0, keep=0.5, quality="duration").apply(flown)
    assert not failed & {*uids(kept)}


def test_weights_fall_from_the_best_to_the_worst(demos: list[Episode]) -> None:
    ranked = [replace(d, rewards=np.full(len(d), 0.1 * k)) for k, d in enumerate(demos)]
    _, weights = replace(EVERYONE, quality="reward", sharpness=2.0).apply(ranked)
    np.testing.assert_allclose(weights, np.exp(-2.0 * np.arange(5, -1, -1) / 5))
    _, weights = replace(EVERYONE, operator_weights={"person": 3.0}).apply(demos)
    np.testing.assert_allclose(weights, [1, 3] * 3)


def test_failed_flights_count_as_much_as_is_said(demos: list[Episode]) -> None:
    mixed = [replace(d, success=k < 4) for k, d in enumerate(demos)]
    kept, weights = replace(EVERYONE, failures=0.5).apply(mixed)
    assert uids(kept) == uids(demos)
    np.testing.assert_array_equal(weights, [1, 1, 1, 1, 0.5, 0.5])
    for failures, count in ((0.0, 4), (0.5, 6)):
        cloning = BC(selection=replace(EVERYONE, failures=failures), validation=0.0)
        divided = cloning.divide(mixed, MLP(chunk=4, masked_fields=()), seed=0)
        assert len(divided.kept) == count
    labelled = BC(validation=0.0).divide(mixed, MLP(chunk=4, masked_fields=()), seed=0, failures=True)
    assert (labelled.weights == 1).all()


@pytest.mark.parametrize(
    "wrong",
    [
        {"failures": -1.0},
        {"keep": 0.0},
        {"keep": 1.5},
        {"sharpness": -1.0},
        {"quality": "beauty"},
        {"operator_weights": {"a": 0.0}},
    ],
)
def test_impossible_choices_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(InvalidValueError):
        replace(EVERYONE, **wrong)  # type: ignore[arg-type]


def test_windows_are_visited_as_often_as_they_weigh() -> None:
    weights = np.array([1.0, 2.0, 0.5, 0.5] * 25)
    order = Shuffle(100, 10, seed=0, weights=weights)
    visits = np.concatenate([order[step] for step in range(200)]).reshape(20, 100)  # 20 epochs
    counts = np.stack([np.bincount(epoch, minlength=100) for epoch in visits])
    np.testing.assert_allclose(counts[:, weights == 1].mean(), 1)
    np.testing.assert_allclose(counts[:, weights == 2], 2)
    assert 0.4 < counts[:, weights == 0.5].mean() < 0.6
    assert counts.sum(axis=1).tolist() == [100] * 20
    assert not np.array_equal(visits[0], visits[1])


def test_weights_reach_the_windows_and_the_digest(demos: list[Episode]) -> None:
    config = MLP(chunk=4, masked_fields=())
    layout, kept = read_demos(demos, config)
    windows = cut_windows(kept, layout, config)
    assert window_weights(np.ones(6), windows) is None
    weights = window_weights(np.arange(1.0, 7.0), windows)
    assert weights is not None
    np.testing.assert_array_equal(weights, np.repeat(np.arange(1.0, 7.0), [len(d) for d in demos]))
    assert digest_of(windows, weights) != digest_of(windows)
