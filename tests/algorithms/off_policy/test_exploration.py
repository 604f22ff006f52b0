"""Noise of policies without chance: its deviation and correlation, and that a run goes on with the same."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import torch

from aerial_il.algorithms.off_policy.exploration import ExplorationNoise
from aerial_il.policies.squashed_gaussian import SquashedGaussian, SquashedGaussianNetwork

OBS = np.zeros((4_000, 3), np.float32)


@pytest.fixture
def actor() -> SquashedGaussianNetwork:
    torch.manual_seed(0)
    return SquashedGaussian(hidden=(4,)).build(3, 1)


def drawn(noise: ExplorationNoise, actor: SquashedGaussianNetwork, steps: int) -> np.ndarray:
    """Return what was added to the actor's centre, (steps, n)."""
    with torch.no_grad():
        centre = actor(torch.from_numpy(OBS)[:, None])[:, 0].numpy()
    return np.stack([(noise.explore(actor, OBS) - centre)[:, 0] for _ in range(steps)])


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_noise_has_its_deviation_and_correlation_at_every_step(
    actor: SquashedGaussianNetwork, correlation: float
) -> None:
    found = drawn(ExplorationNoise(0.1, correlation), actor, 20)
    np.testing.assert_allclose(found.std(axis=1), 0.1, rtol=0.06)
    between = [np.corrcoef(a, b)[0, 1] for a, b in pairwise(found)]
    np.testing.assert_allclose(between, correlation, atol=0.06)


def test_noise_goes_on_where_it_was_interrupted(actor: SquashedGaussianNetwork) -> None:
    before, after = ExplorationNoise(0.1, 0.9), ExplorationNoise(0.1, 0.9)
    drawn(before, actor, 3)
    after.restore(before.snapshot())
    torch.manual_seed(1)
    wanted = drawn(before, actor, 2)
    torch.manual_seed(1)
    np.testing.assert_array_equal(drawn(after, actor, 2), wanted)
