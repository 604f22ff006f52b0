"""Noise is a function of the episode; a policy with fields hidden is led by what it sees alone."""

import numpy as np
import pytest
import torch
from scipy import stats

from aerial_il.algorithms.bc import with_dropout
from aerial_il.policies.parts.masked import MaskedPolicy, columns_of
from aerial_il.policies.parts.network import Seen
from aerial_il.policies.parts.noise import EpisodeNoise, fingerprints, glimpses, normal_numbers
from tests.algorithms.point_mass import PointMassBatch
from tests.policies.test_registry import fresh_policy

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


CALLS = 30


def flown(*, most: float, hold: float, seeds: np.ndarray, stream: int = 0) -> np.ndarray:
    """Return actions (CALLS, n, Da) for observations that stay as they are at the start of the episode 7."""
    policy = MaskedPolicy(fresh_policy("mlp"), most=most, hold=hold, stream=stream)
    obs = {name: np.repeat(value, len(seeds), axis=0) for name, value in PointMassBatch(1).reset(7).items()}
    policy.reset()
    policy.begin(seeds)
    return np.stack([policy.act(obs) for _ in range(CALLS)])


def test_with_nothing_hidden_it_flies_as_the_policy_does() -> None:
    policy, obs = fresh_policy("mlp"), PointMassBatch(1).reset(7)
    plain = np.stack([policy.act(obs) for _ in range(CALLS)])
    np.testing.assert_array_equal(flown(most=0.0, hold=5.0, seeds=np.array([7])), plain)


def test_what_is_hidden_depends_on_episode_and_stream_alone() -> None:
    together = flown(most=0.9, hold=5.0, seeds=np.array([3, 4, 5]))
    for world, seed in enumerate((3, 4, 5)):
        alone = flown(most=0.9, hold=5.0, seeds=np.array([seed]))
        np.testing.assert_allclose(together[:, world], alone[:, 0], atol=1e-6)
    assert np.abs(together[:, 0] - together[:, 1]).max() > 1e-3
    assert np.abs(flown(most=0.9, hold=5.0, seeds=np.array([3]), stream=1)[:, 0] - together[:, 0]).max() > 1e-3


def test_others_are_hidden_from_time_to_time() -> None:
    kept = flown(most=0.9, hold=1e9, seeds=np.arange(8))
    drawn = flown(most=0.9, hold=3.0, seeds=np.arange(8))
    assert np.ptp(kept[20:], axis=0).max() < 1e-4, "the same fields, the same observation, and yet other actions"
    assert np.ptp(drawn[20:], axis=0).max() > 1e-3


def test_a_hidden_field_has_no_say() -> None:
    policy = fresh_policy("mlp", anchor=None)
    masked = MaskedPolicy(policy, most=0.0, hold=1.0)
    layout, rng = policy.interface.layout, np.random.default_rng(0)
    one, other = (rng.normal(size=(1, policy.config.history, layout.size)) for _ in range(2))
    fields = np.arange(len(layout.names)) == 0
    hidden = columns_of(layout, fields)
    mixed = np.where(hidden, other, one)
    masked.begin(np.array([0]))
    assert np.abs(masked.predict(mixed) - masked.predict(one)).max() > 1e-4
    masked._shown[:] = ~hidden
    np.testing.assert_array_equal(masked.predict(mixed), masked.predict(one))


@pytest.mark.parametrize("most", [0.3, 0.9])
def test_training_hides_whole_fields_at_the_chance_it_says(most: float) -> None:
    layout = fresh_policy("mlp").interface.layout
    torch.manual_seed(0)
    images = {"wrist_rgb": torch.ones(4000, 2, 1, 1, 3, dtype=torch.uint8)}
    result = with_dropout(Seen(torch.ones(4000, 2, layout.size), images), layout, most)
    assert isinstance(result, Seen)
    assert result.images is images
    state = result.state
    assert (state[:, 0] == state[:, 1]).all(), "hidden in one frame of the history and shown in the other"
    firsts = np.cumsum([0, *(layout.spec.observation[name].size for name in layout.names)])[:-1]
    fields = state[:, 0, firsts]
    assert (columns_of(layout, fields) == state[:, 0]).all()
    assert abs((fields == 0).float().mean().item() - most / 2) < 0.02
    assert (fields == 0).float().mean(1).std() > 0.5 * most / 12**0.5, "the chance differs from window to window"
