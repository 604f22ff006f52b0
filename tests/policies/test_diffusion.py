"""Diffusion: every prediction target gives the right actions, both samplers follow the data, two ways are kept."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor, nn

from aerial_il.policies.diffusion import Diffusion, squared_cosine
from tests.policies.two_ways import CHUNK, TwoWays

TARGETS, SAMPLERS = ("sample", "noise", "velocity"), ("ddim", "ddpm")


class Oracle(nn.Module):
    """A denoiser that knows the data, independent elements N(``mean``, ``deviation``^2), and so the best answer."""

    def __init__(self, config: Diffusion, mean: Tensor, deviation: float) -> None:
        super().__init__()
        self.predict, self.schedule = config.predict, squared_cosine(config.noise_steps)
        self.mean, self.variance = mean, deviation**2

    def see(self, obs: Tensor) -> Tensor:
        return obs

    def forward(self, noisy: Tensor, time: Tensor, seen: Tensor) -> Tensor:
        kept = self.schedule[(time * (len(self.schedule) - 1)).round().long()]
        gain = kept.sqrt() * self.variance / (kept * self.variance + 1 - kept)
        actions = self.mean + gain * (noisy - kept.sqrt() * self.mean)
        noise = (noisy - kept.sqrt() * actions) / (1 - kept).sqrt()
        velocity = kept.sqrt() * noise - (1 - kept).sqrt() * actions
        return {"sample": actions, "noise": noise, "velocity": velocity}[self.predict]


def flown_by_oracle(mean: Tensor, deviation: float, **settings: Any) -> Tensor:
    """Return 4000 chunks (N, CHUNK * 2) that the oracle's answers lead to."""
    network = Diffusion(chunk=CHUNK, width=8, **settings).build(1, 2).eval()
    network.denoiser = Oracle(network.config, mean, deviation)  # type: ignore[assignment]
    noise = torch.randn(4000, network.noise_size, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        return network(torch.zeros(4000, 1, 1), noise).flatten(1)


@pytest.mark.parametrize("steps", [1, 7, 20])
@pytest.mark.parametrize("sampler", SAMPLERS)
@pytest.mark.parametrize("predict", TARGETS)
def test_exact_answers_leave_no_noise(predict: str, sampler: str, steps: int) -> None:
    wanted = torch.linspace(-2, 2, CHUNK * 2)
    flown = flown_by_oracle(wanted, 0.0, predict=predict, sampler=sampler, denoise_steps=steps)
    torch.testing.assert_close(flown, wanted.expand_as(flown), atol=5e-3, rtol=0)  # noise: 400 rounding errors


@pytest.mark.parametrize("sampler", SAMPLERS)
@pytest.mark.parametrize("predict", TARGETS)
def test_samples_are_spread_as_the_data(predict: str, sampler: str) -> None:
    mean = torch.linspace(-1, 1, CHUNK * 2)
    settings = {"noise_steps": 100, "denoise_steps": 100, "clip": 50.0}
    flown = flown_by_oracle(mean, 0.5, predict=predict, sampler=sampler, **settings)
    torch.testing.assert_close(flown.mean(0), mean, atol=0.05, rtol=0)
    torch.testing.assert_close(flown.std(0), torch.full((CHUNK * 2,), 0.5), atol=0.05, rtol=0)


def test_either_of_two_ways_is_flown_and_nothing_between() -> None:
    torch.manual_seed(0)
    network, ways = Diffusion(chunk=CHUNK, width=128).build(2, 2), TwoWays()
    ways.teach(network, steps=500)
    obs, noise = torch.rand(500, 1, 2) * 2 - 1, torch.randn(500, network.noise_size)
    with torch.no_grad():
        flown, moved = network(obs, noise), network(obs + 0.02, noise)
    near, way = ways.nearest(flown, obs)
    assert (near < 0.2).float().mean() > 0.9, "at a way, and not at the centre between them"
    assert 0.3 < way.float().mean() < 0.7, "both are flown"
    stayed = ways.nearest(moved, obs + 0.02)[1] == way
    assert stayed.float().mean() > 0.95, "the same noise goes the same way one step later"
