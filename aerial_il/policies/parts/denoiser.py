"""The network inside diffusion and flow matching: from a noisy chunk, a time and an observation to a direction."""

import math
from typing import cast

import torch
from torch import Tensor, nn

TIME_SIZE = 16  # numbers that tell the time
SLOWEST, FASTEST = 1.0, 1000.0  # radians that its waves turn in the unit of time


class Denoiser(nn.Module):
    """A residual perceptron.

    Args:
        obs: columns of the flattened observation history. chunk: columns of the flattened chunk.
        width: of each hidden layer. blocks: residual blocks of two layers each, after a first layer.

    Source: A. Ren et al., "Diffusion Policy Policy Optimization" (DPPO), 2024, appendix: a residual perceptron with
    three hidden layers of 512 (one block) serves state observations.
    """

    def __init__(self, obs: int, chunk: int, *, width: int, blocks: int) -> None:
        super().__init__()
        self.see = nn.Linear(obs, width)
        self.place = nn.Linear(chunk, width, bias=False)
        self.clock = nn.Sequential(nn.Linear(TIME_SIZE, 2 * TIME_SIZE), nn.Mish(), nn.Linear(2 * TIME_SIZE, width))
        self.blocks = nn.ModuleList(_Block(width) for _ in range(blocks))
        self.last = nn.Sequential(nn.Mish(), nn.Linear(width, chunk))
        waves = torch.logspace(math.log10(SLOWEST), math.log10(FASTEST), TIME_SIZE // 2)
        self.register_buffer("waves", waves, persistent=False)

    def forward(self, noisy: Tensor, time: Tensor, seen: Tensor) -> Tensor:
        """Return a direction (B, C).

        Args:
            noisy: (B, C). time: (B, 1) in [0, 1], or (1, 1) for all alike. seen: (B, W), what ``see`` makes of the
                observation, which is the same for all steps of one prediction.
        """
        angle = time * cast(Tensor, self.waves)
        x = self.place(noisy) + self.clock(torch.cat([angle.sin(), angle.cos()], -1)) + seen
        for block in self.blocks:
            x = x + block(x)
        return self.last(x)


class _Block(nn.Sequential):
    def __init__(self, width: int) -> None:
        super().__init__(nn.LayerNorm(width), nn.Mish(), nn.Linear(width, width), nn.Mish(), nn.Linear(width, width))
