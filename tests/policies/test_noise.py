"""Noise is standard normal, and a function of an episode's first observation and of nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from aerial_il.policies.parts.noise import EpisodeNoise, fingerprints, glimpses, normal_numbers

ALL = np.ones(4, bool)


@pytest.fixture
def frames() -> np.ndarray:
    return np.random.default_rng(0).normal(size=(4, 3))


def test_numbers_are_standard_normal_and_independent() -> None:
    numbers = normal_numbers(fingerprints(np.arange(300.0)[:, None]), 101)
    assert numbers.shape == (300, 101)
    assert numbers.dtype == np.float32
    assert stats.kstest(numbers.ravel(), "norm").pvalue > 1e-3
    correlation = np.corrcoef(numbers.T) - np.eye(101)
    assert np.abs(correlation).max() < 0.3  # 5 deviations of a chance correlation over 300 rows
    assert np.abs(np.corrcoef(numbers) - np.eye(300)).max() < 0.55


def test_numbers_depend_on_the_own_row_only() -> None:
    frames = np.random.default_rng(0).normal(size=(50, 7))
    keys = fingerprints(frames)
    assert len(np.unique(keys)) == 50
    np.testing.assert_array_equal(fingerprints(frames[7:8]), keys[7:8])
    np.testing.assert_array_equal(normal_numbers(keys[7:8], 33)[0], normal_numbers(keys, 33)[7])
    np.testing.assert_array_equal(fingerprints(np.zeros((1, 3))), fingerprints(-np.zeros((1, 3))))
    frames[3, 4] = np.nextafter(frames[3, 4], 9)
    np.testing.assert_array_equal(fingerprints(frames) != keys, np.arange(50) == 3)


def test_an_episode_keeps_its_numbers_whatever_it_sees_later(frames: np.ndarray) -> None:
    noise = EpisodeNoise(5)
    first = noise.take(frames, ALL)
    np.testing.assert_array_equal(noise.take(frames + 1, ALL), first)
    np.testing.assert_array_equal(noise.take(frames + 1, np.array([True, False, True, False])), first[[0, 2]])


def test_a_glimpse_is_told_by_every_pixel_and_by_its_own_world() -> None:
    images = np.random.default_rng(0).integers(0, 256, (5, 8, 9, 3), dtype=np.uint8)
    seen = glimpses([images, images])
    assert seen.shape == (5, 2)
    assert len(np.unique(seen[:, 0])) == 5
    np.testing.assert_array_equal(glimpses([images[3:4]])[0, 0], seen[3, 0])
    images[1, 7, 8, 2] ^= 1
    np.testing.assert_array_equal(glimpses([images])[:, 0] != seen[:, 0], np.arange(5) == 1)


def test_redrawing_gives_new_numbers_to_those_that_predict(frames: np.ndarray) -> None:
    noise, some = EpisodeNoise(5, redraw=True), np.array([True, False, False, False])
    first, second = noise.take(frames, ALL), noise.take(frames, some)
    assert not np.isclose(first[0], second[0]).any()
    third = noise.take(frames + 1, ALL)
    noise.reset()
    np.testing.assert_array_equal(noise.take(frames, ALL), first)
    np.testing.assert_array_equal(noise.take(frames, ALL)[1:], third[1:])


def test_a_reset_world_draws_by_what_it_sees_then(frames: np.ndarray) -> None:
    noise, mask = EpisodeNoise(5), np.array([False, True, False, False])
    first = noise.take(frames, ALL)
    noise.reset(mask)
    second = noise.take(frames[::-1].copy(), ALL)
    np.testing.assert_array_equal(second[[0, 2, 3]], first[[0, 2, 3]])
    np.testing.assert_array_equal(second[1], first[2])


def test_a_policy_without_chance_takes_none(frames: np.ndarray) -> None:
    assert EpisodeNoise(0).take(frames, ALL).shape == (4, 0)
