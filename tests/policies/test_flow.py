"""Flow: both things that the network may answer with lead to the right actions, spread as the data are."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor, nn

from aerial_il.policies.flow import Flow
from tests.policies.two_ways import CHUNK, TwoWays

TARGETS = ("sample", "velocity")


class Oracle(nn.Module):
    """A network that knows the data, independent elements N(``mean``, ``deviation``^2), and so the best answer."""

    def __init__(self, predict: str, mean: Tensor, deviation: float) -> None:
        super().__init__()
        self.predict, self.mean, self.variance = predict, mean, deviation**2

    def see(self, obs: Tensor) -> Tensor:
        return obs

    def forward(self, place: Tensor, time: Tensor, seen: Tensor) -> Tensor:
        gain = time * self.variance / (time**2 * self.variance + (1 - time) ** 2)
        actions = self.mean + gain * (place - time * self.mean)
        return actions if self.predict == "sample" else (actions - place) / (1 - time)


def flown_by_oracle(mean: Tensor, deviation: float, predict: str, **settings: Any) -> Tensor:
    """Return 4000 chunks (N, CHUNK * 2) that the oracle's answers lead to."""
    network = Flow(chunk=CHUNK, width=8, predict=predict, **settings).build(1, 2).eval()  # type: ignore[arg-type]
    network.denoiser = Oracle(predict, mean, deviation)  # type: ignore[assignment]
    noise = torch.randn(4000, network.noise_size, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        return network(torch.zeros(4000, 1, 1), noise).flatten(1)


@pytest.mark.parametrize("steps", [1, 7, 20])
@pytest.mark.parametrize("predict", TARGETS)
def test_exact_answers_leave_no_noise(predict: str, steps: int) -> None:
    wanted = torch.linspace(-2, 2, CHUNK * 2)
    flown = flown_by_oracle(wanted, 0.0, predict, euler_steps=steps)
    torch.testing.assert_close(flown, wanted.expand_as(flown), atol=1e-4, rtol=0)


@pytest.mark.parametrize("predict", TARGETS)
def test_samples_are_spread_as_the_data(predict: str) -> None:
    mean = torch.linspace(-1, 1, CHUNK * 2)
    flown = flown_by_oracle(mean, 0.5, predict, euler_steps=200)
    torch.testing.assert_close(flown.mean(0), mean, atol=0.05, rtol=0)
    torch.testing.assert_close(flown.std(0), torch.full((CHUNK * 2,), 0.5), atol=0.05, rtol=0)


@pytest.mark.parametrize("predict", TARGETS)
def test_what_is_learned_is_what_flying_takes_it_for(predict: str) -> None:
    torch.manual_seed(0)
    network, ways = Flow(chunk=CHUNK, width=128, predict=predict).build(2, 2), TwoWays()  # type: ignore[arg-type]
    ways.teach(network, steps=500)
    obs = torch.rand(500, 1, 2) * 2 - 1
    with torch.no_grad():
        flown = network(obs, torch.randn(500, network.noise_size))
    near, way = ways.nearest(flown, obs)
    assert (near < 0.2).float().mean() > 0.85, "at a way, and not at the centre between them"
    assert 0.3 < way.float().mean() < 0.7, "both are flown"
