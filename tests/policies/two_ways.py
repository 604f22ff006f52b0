"""Two ways beside a centre that the observation decides: what follows one of several ways must not fly their mean."""

import torch
from torch import Tensor

from aerial_il.policies.parts.network import ChunkNetwork

CHUNK = 3  # actions, of two elements each


class TwoWays:
    """Both lie 0.5 from a centre; the mean of the demonstrations is that centre."""

    def __init__(self) -> None:
        self._turn = torch.randn(2, CHUNK * 2)

    def of(self, obs: Tensor) -> Tensor:
        """Return both chunks (N, 2, CHUNK, 2) for ``obs`` (N, 1, 2)."""
        centre = torch.sin(obs[:, 0] @ self._turn)
        return torch.stack([centre + 0.5, centre - 0.5], 1).unflatten(-1, (CHUNK, 2))

    def teach(self, network: ChunkNetwork, steps: int) -> None:
        """Show windows whose chunk is either way of what is seen; the last steps are small ones."""
        optimizer = torch.optim.Adam(network.train().parameters())
        for step in range(steps):
            optimizer.param_groups[0]["lr"] = 3e-3 * (1 - step / steps)
            obs = torch.rand(256, 1, 2) * 2 - 1
            chunks = self.of(obs)[torch.arange(256), torch.randint(2, (256,))]
            loss, _ = network.loss(obs, chunks, torch.ones(256, CHUNK))
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
        network.eval()

    def nearest(self, flown: Tensor, obs: Tensor) -> tuple[Tensor, Tensor]:
        """Return how far ``flown`` (N, CHUNK, 2) lies from the nearer way (N,), and which one that is (N,)."""
        near, way = (flown[:, None] - self.of(obs)).abs().mean((-1, -2)).min(1)
        return near, way
