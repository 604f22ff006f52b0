"""Two-valued action elements are found in the data and flown at one of their values."""

from __future__ import annotations

import numpy as np
import pytest

from aerial_il.policies.parts.switches import Switches


@pytest.fixture
def fitted() -> Switches:
    """Of a continuous, a two-valued and a constant element."""
    rng = np.random.default_rng(0)
    actions = np.stack([rng.normal(size=99), rng.choice([0.2, 1.0], 99), np.full(99, 0.5)], axis=1)
    return Switches.fit(actions.astype(np.float32))


def test_only_elements_with_two_values_are_switches(fitted: Switches) -> None:
    np.testing.assert_array_equal(np.isnan(fitted.low), [True, False, True])
    np.testing.assert_allclose([fitted.low[1], fitted.high[1]], [0.2, 1.0])


def test_a_rare_third_value_leaves_a_switch_a_switch() -> None:
    actions = np.ones((100, 1), np.float32)
    actions[:30], actions[97:] = 0.0, 0.6
    np.testing.assert_array_equal(Switches.fit(actions).snap(np.array([[0.4], [0.55]])), [[0.0], [1.0]])
    actions[80:] = 0.6
    assert np.isnan(Switches.fit(actions).low).all()


def test_they_snap_to_the_nearer_value_and_others_are_left_alone(fitted: Switches) -> None:
    actions = np.array([[0.3, 0.5, 0.1], [0.4, 0.7, 0.2], [-9.0, -3.0, 7.0]])
    snapped = fitted.snap(actions)
    np.testing.assert_allclose(snapped[:, 1], [0.2, 1.0, 0.2])
    np.testing.assert_array_equal(snapped[:, [0, 2]], actions[:, [0, 2]])


def test_a_choice_among_several_is_left_to_its_scores() -> None:
    scores = np.array([[0.2, 0.45, 0.35]])
    for shown in (np.eye(3, dtype=np.float32)[[0, 1, 2, 1]], np.eye(3, dtype=np.float32)[[0, 1, 0, 1]]):
        np.testing.assert_array_equal(Switches.fit(shown).snap(scores), scores)
    both = np.array([[0, 0], [1, 1], [1, 0]], np.float32)
    assert not np.isnan(Switches.fit(both).low).any(), "two grippers that close together are no choice"


def test_arrays_bring_them_back(fitted: Switches) -> None:
    again = Switches.from_arrays(fitted.arrays())
    np.testing.assert_array_equal([again.low, again.high], [fitted.low, fitted.high])
    actions = np.random.default_rng(1).normal(size=(5, 3))
    np.testing.assert_array_equal(Switches.none(3).snap(actions), actions)


def test_elements_can_be_held_at_a_constant(fitted: Switches) -> None:
    held = fitted.holding(np.array([True, False, False]), np.array([0.7, 0.0, 0.0], np.float32))
    snapped = held.snap(np.array([[9.0, 0.3, 4.0], [-9.0, 0.9, 5.0]]))
    np.testing.assert_allclose(snapped, [[0.7, 0.2, 4.0], [0.7, 1.0, 5.0]], rtol=1e-6)
