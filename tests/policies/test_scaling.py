"""Scaling is undone exactly enough; what never varied, or had two values only, is found and flown as it was."""

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from aerial_il.core import checkpoint
from aerial_il.core.errors import CheckpointError, InvalidValueError
from aerial_il.core.specs import ActionSpec
from aerial_il.policies import load_policy
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.constant import ARRAY
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.normaliser import Normaliser, Scaling
from aerial_il.policies.parts.switches import Switches
from tests.algorithms.drift import SPEC


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


WORDS = ("fills its bounds", "stays in their middle", "stays elsewhere", "varies", "fills one unit of its bounds")
BOUND = np.array([1.0, 1.0, 5.0, np.inf, 5.0])
VARIED = [True, False, False, True, True]


def shown() -> np.ndarray:
    """Return demonstrated actions (N, 5), each element as its word says."""
    wave = np.linspace(-1.0, 1.0, 99)
    return np.stack([wave, np.zeros(99), np.full(99, 0.3), 0.7 * wave, 0.5 + wave], axis=1)


def policy_of(scaling: Scaling) -> ChunkPolicy:
    action = ActionSpec("velocity", WORDS, ("m/s",) * 5, -BOUND, BOUND)
    config = MLP(hidden=(4,), chunk=1, anchor=None, masked_fields=(), action_scaling=scaling)
    layout = Layout.of(replace(SPEC, action=action), config)
    scaler, obs = Normaliser.fit(shown(), scaling), Normaliser.none(layout.size)
    interface = Interface(layout, obs, scaler, config.obs_clip, Switches.fit(shown()))
    torch.manual_seed(0)
    return ChunkPolicy(config, interface, config.build(layout.size, 5))


@pytest.mark.parametrize("scaling", get_args(Scaling))
def test_what_varied_is_known_before_and_after_it_was_saved(scaling: Scaling, tmp_path: Path) -> None:
    policy = policy_of(scaling)
    assert policy.interface.varied.tolist() == VARIED
    assert load_policy(policy.save(tmp_path / "policy")).interface.varied.tolist() == VARIED


def test_a_standard_scale_is_saved_as_it_was_before() -> None:
    assert ARRAY in policy_of("minmax").to_checkpoint().arrays
    assert ARRAY not in policy_of("standard").to_checkpoint().arrays


def test_what_fills_the_bounds_is_taken_to_have_varied(tmp_path: Path) -> None:
    saved = policy_of("minmax").to_checkpoint()
    arrays = {name: array for name, array in saved.arrays.items() if name != ARRAY}
    checkpoint.save(tmp_path / "old", replace(saved, arrays=arrays))
    assert load_policy(tmp_path / "old").interface.varied.tolist() == [True, True, False, True, False]


def test_a_file_that_says_it_of_too_many_elements_is_refused(tmp_path: Path) -> None:
    saved = policy_of("minmax").to_checkpoint()
    for constant in (np.zeros(6, bool), np.zeros(5)):
        checkpoint.save(tmp_path / "bad", replace(saved, arrays={**saved.arrays, ARRAY: constant}))
        with pytest.raises(CheckpointError, match=r"constant is .*must be bool \(5,\)"):
            load_policy(tmp_path / "bad")


def test_all_are_explored_where_none_varied() -> None:
    interface = policy_of("standard").interface
    still = replace(interface, action=Normaliser.fit(np.zeros((9, 5))))
    assert still.varied.all()


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
