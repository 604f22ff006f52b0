"""Diffusion and flow: whatever the network answers with leads to the right actions, spread as the data are."""

from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from aerial_il.policies.diffusion import Diffusion, squared_cosine
from aerial_il.policies.flow import Flow
from tests.policies.two_ways import CHUNK, TwoWays


class Oracle(nn.Module):
    """A network that knows the data, independent elements N(``mean``, ``deviation``^2), and so the best answer."""

    def __init__(self, predict: str, mean: Tensor, deviation: float) -> None:
        super().__init__()
        self.predict, self.mean, self.variance = predict, mean, deviation**2

    def see(self, obs: Tensor) -> Tensor:
        return obs


class Denoiser(Oracle):
    """That of a diffusion of so many steps of noise."""

    def __init__(self, predict: str, mean: Tensor, deviation: float, noise_steps: int) -> None:
        super().__init__(predict, mean, deviation)
        self.schedule = squared_cosine(noise_steps)

    def forward(self, noisy: Tensor, time: Tensor, seen: Tensor) -> Tensor:
        kept = self.schedule[(time * (len(self.schedule) - 1)).round().long()]
        gain = kept.sqrt() * self.variance / (kept * self.variance + 1 - kept)
        actions = self.mean + gain * (noisy - kept.sqrt() * self.mean)
        noise = (noisy - kept.sqrt() * actions) / (1 - kept).sqrt()
        velocity = kept.sqrt() * noise - (1 - kept).sqrt() * actions
        return {"sample": actions, "noise": noise, "velocity": velocity}[self.predict]


class Field(Oracle):
    """That of a flow."""

    def forward(self, place: Tensor, time: Tensor, seen: Tensor) -> Tensor:
        gain = time * self.variance / (time**2 * self.variance + (1 - time) ** 2)
        actions = self.mean + gain * (place - time * self.mean)
        return actions if self.predict == "sample" else (actions - place) / (1 - time)


FLOWS = [Flow(chunk=CHUNK, predict=predict) for predict in ("sample", "velocity")]
DIFFUSIONS = [
    Diffusion(chunk=CHUNK, predict=predict, sampler=sampler)
    for predict in ("sample", "noise", "velocity")
    for sampler in ("ddim", "ddpm")
]
each = pytest.mark.parametrize("config", [*FLOWS, *DIFFUSIONS], ids=str)


def flown_by_oracle(config: Any, mean: Tensor, deviation: float, *, steps: int, **settings: Any) -> Tensor:
    """Return 4000 chunks (N, CHUNK * 2) that the oracle's answers lead to in so many steps."""
    is_flow = isinstance(config, Flow)
    changed = {"euler_steps": steps} if is_flow else {"denoise_steps": steps, **settings}
    network = replace(config, width=8, **changed).build(1, 2).eval()
    known = (config.predict, mean, deviation)
    network.denoiser = Field(*known) if is_flow else Denoiser(*known, network.config.noise_steps)
    noise = torch.randn(4000, network.noise_size, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        return network(torch.zeros(4000, 1, 1), noise).flatten(1)


@each
@pytest.mark.parametrize("steps", [1, 7, 20])
def test_exact_answers_leave_no_noise(config: Any, steps: int) -> None:
    wanted = torch.linspace(-2, 2, CHUNK * 2)
    flown = flown_by_oracle(config, wanted, 0.0, steps=steps)
    rounding = 1e-4 if isinstance(config, Flow) else 5e-3  # diffusion multiplies its errors by up to 400
    torch.testing.assert_close(flown, wanted.expand_as(flown), atol=rounding, rtol=0)


@each
def test_samples_are_spread_as_the_data(config: Any) -> None:
    mean = torch.linspace(-1, 1, CHUNK * 2)
    steps = 200 if isinstance(config, Flow) else 100
    flown = flown_by_oracle(config, mean, 0.5, steps=steps, noise_steps=100, clip=50.0)
    torch.testing.assert_close(flown.mean(0), mean, atol=0.05, rtol=0)
    torch.testing.assert_close(flown.std(0), torch.full((CHUNK * 2,), 0.5), atol=0.05, rtol=0)


@pytest.mark.parametrize("config", [*FLOWS, Diffusion(chunk=CHUNK)], ids=["sample", "velocity", "diffusion"])
def test_either_of_two_ways_is_flown_and_nothing_between(config: Any) -> None:
    torch.manual_seed(0)
    network, ways = replace(config, width=128).build(2, 2), TwoWays()
    ways.teach(network, steps=500)
    obs, noise = torch.rand(500, 1, 2) * 2 - 1, torch.randn(500, network.noise_size)
    with torch.no_grad():
        flown, moved = network(obs, noise), network(obs + 0.02, noise)
    near, way = ways.nearest(flown, obs)
    assert (near < 0.2).float().mean() > 0.85, "at a way, and not at the centre between them"
    assert 0.3 < way.float().mean() < 0.7, "both are flown"
    stayed = ways.nearest(moved, obs + 0.02)[1] == way
    assert stayed.float().mean() > 0.95, "the same noise goes the same way one step later"
