"""A policy with fields hidden: what is hidden has no say, and what is drawn depends on the episode alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from aerial_il.algorithms.bc import with_dropout
from aerial_il.core import checkpoint
from aerial_il.core.checkpoint import Checkpoint
from aerial_il.policies import load_policy
from aerial_il.policies.parts.masked import MaskedPolicy, columns_of
from aerial_il.policies.parts.network import Seen
from tests.algorithms.point_mass import PointMassBatch
from tests.policies.test_registry import fresh_policy

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
    found = with_dropout(Seen(torch.ones(4000, 2, layout.size), images), layout, most)
    assert isinstance(found, Seen)
    assert found.images is images
    state = found.state
    assert (state[:, 0] == state[:, 1]).all(), "hidden in one frame of the history and shown in the other"
    firsts = np.cumsum([0, *(layout.spec.observation[name].size for name in layout.names)])[:-1]
    fields = state[:, 0, firsts]
    assert (columns_of(layout, fields) == state[:, 0]).all()
    assert abs((fields == 0).float().mean().item() - most / 2) < 0.02
    assert (fields == 0).float().mean(1).std() > 0.5 * most / 12**0.5, "the chance differs from window to window"


def test_what_was_saved_under_an_older_name_of_a_setting_still_flies(tmp_path: Path) -> None:
    policy = fresh_policy("mlp")
    saved = policy.to_checkpoint()
    settings = {"blind_to" if n == "masked_fields" else n: value for n, value in saved.config["settings"].items()}
    checkpoint.save(tmp_path / "old", Checkpoint(saved.arrays, saved.state, {**saved.config, "settings": settings}))
    assert load_policy(tmp_path / "old").config == policy.config
