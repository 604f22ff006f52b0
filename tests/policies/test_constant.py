"""What never varied is told from what fills [-1, 1], though both are normalised by 1, in files as in memory."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import torch

from aerial_il.core import checkpoint
from aerial_il.core.errors import CheckpointError
from aerial_il.core.specs import ActionSpec
from aerial_il.policies import load_policy
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.constant import ARRAY
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.normaliser import Normaliser, Scaling
from aerial_il.policies.parts.switches import Switches
from tests.algorithms.drift import SPEC

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
