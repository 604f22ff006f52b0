"""Scaling is undone exactly enough, and what is constant stays harmless."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.normaliser import Normaliser, Scaling


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000), st.sampled_from(["standard", "minmax"]), st.floats(0.01, 1e3), st.floats(-100, 100))
def test_denormalising_undoes_normalising(seed: int, scaling: Scaling, spread: float, centre: float) -> None:
    data = np.random.default_rng(seed).normal(centre, spread, size=(50, 4))
    scaler = Normaliser.fit(data, scaling)
    np.testing.assert_allclose(
        scaler.denormalise(scaler.normalise(data)), data, atol=2e-6 * (spread + abs(centre)) + 1e-6
    )


def test_standard_has_deviation_one_and_minmax_fills_the_range() -> None:
    data = np.random.default_rng(0).uniform(-3, 5, size=(2000, 3)) * [1, 10, 0.1]
    standard = Normaliser.fit(data).normalise(data)
    np.testing.assert_allclose(standard.mean(0), 0, atol=1e-4)
    np.testing.assert_allclose(standard.std(0), 1, atol=1e-4)
    minmax = Normaliser.fit(data, "minmax").normalise(data)
    np.testing.assert_allclose([minmax.min(0), minmax.max(0)], [[-1] * 3, [1] * 3], atol=1e-5)


@pytest.mark.parametrize("scaling", ["standard", "minmax"])
def test_a_constant_element_is_centred_and_not_blown_up(scaling: Scaling) -> None:
    rng = np.random.default_rng(0)
    data = np.stack([rng.normal(size=500), np.full(500, 0.7), 1 + 1e-6 * rng.normal(size=500)], axis=1)
    scaler = Normaliser.fit(data, scaling)
    np.testing.assert_allclose(scaler.normalise(data)[:, 1:], 0, atol=1e-5)
    np.testing.assert_array_equal(scaler.constant, [False, True, True])
    assert scaler.normalise(np.array([0.0, 0.8, 1.1]))[2] == pytest.approx(0.1, abs=1e-4)


def test_arrays_bring_it_back() -> None:
    scaler = Normaliser.fit(np.random.default_rng(0).normal(size=(10, 2)))
    again = Normaliser.from_arrays(scaler.arrays("obs"), "obs")
    np.testing.assert_array_equal([again.centre, again.scale], [scaler.centre, scaler.scale])


def test_nothing_to_fit_and_nonsense_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="N > 0"):
        Normaliser.fit(np.zeros((0, 3)))
    with pytest.raises(InvalidValueError, match="standard, minmax"):
        Normaliser.fit(np.zeros((4, 3)), "quantile")  # pyright: ignore[reportArgumentType]
    with pytest.raises(InvalidValueError, match="finite"):
        Normaliser(np.array([np.nan]), np.array([1.0]))
