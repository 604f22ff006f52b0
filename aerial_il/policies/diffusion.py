"""Diffusion: the chunk is what is left when a network has taken the noise out of noise, step by step.

    training:  x_t = sqrt(A_t) a + sqrt(1 - A_t) e,    loss = |e - e_theta(x_t, t, o)|^2,    e ~ N(0, 1), t uniform
    flying:    a_hat = (x_t - sqrt(1 - A_t) e_theta) / sqrt(A_t), limited to +-clip;
               x_s = sqrt(A_s) a_hat + sqrt(1 - A_s - v) e_hat + sqrt(v) z,    from x_T ~ N(0, 1) down to x_0 = a_hat

with A_t the squared-cosine schedule, e_hat the noise that belongs to the limited a_hat, and v = 0 (``ddim``) or the
posterior variance (``ddpm``). It can follow any of several ways that the demonstrations show. Under ``ddim`` and
with the noise kept for an episode it stays on the way that it began. It needs more optimisation steps than a
perceptron, and its actions carry what noise is left after few denoising steps.

Source: C. Chi et al., "Diffusion Policy", 2023 (epsilon prediction, clip, min-max actions); A. Nichol, P. Dhariwal,
"Improved Denoising Diffusion Probabilistic Models", 2021, eq. 17 (schedule); J. Song et al., "Denoising Diffusion
Implicit Models", 2021, eq. 12 (both samplers); A. Ren et al., "DPPO", 2024 (size for a processor: 512 x 3, 20 steps).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, get_args

import torch
from torch import Tensor
from torch.nn import functional

from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.denoiser import Denoiser
from aerial_il.policies.parts.layers import check_choice, check_positive
from aerial_il.policies.parts.network import ChunkNetwork, PolicyConfig, hold_last
from aerial_il.policies.parts.normaliser import Scaling

Sampler = Literal["ddim", "ddpm"]
OFFSET, LARGEST_BETA = 0.008, 0.999


@dataclass(frozen=True, kw_only=True)
class DiffusionConfig(PolicyConfig):
    """Sizes of the network, the schedule and how it is run backwards.

    Attributes:
        width: of each hidden layer. blocks: residual blocks of two hidden layers each, after a first one.
        noise_steps: steps of the schedule.
        denoise_steps: how many of them are taken when flying, evenly chosen.
        sampler: ``ddim`` (noise at the start only) or ``ddpm`` (at every step).
        clip: limit of normalised actions while denoising; 1 is the range of the data under ``minmax``.
        redraw: draw noise anew for each chunk rather than once per episode.
    """

    action_scaling: Scaling = "minmax"
    width: int = 512
    blocks: int = 1
    noise_steps: int = 20
    denoise_steps: int = 10
    sampler: Sampler = "ddim"
    clip: float = 1.0
    redraw: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice("sampler", self.sampler, get_args(Sampler))
        check_positive(width=self.width, blocks=self.blocks, noise_steps=self.noise_steps, clip=self.clip)
        if not 1 <= self.denoise_steps <= self.noise_steps:
            raise InvalidValueError(
                f"denoise_steps is {self.denoise_steps}; it must lie in [1, {self.noise_steps}], that is noise_steps."
            )

    def build(self, obs_size: int, action_size: int) -> Diffusion:
        return Diffusion(self, obs_size, action_size)


class Diffusion(ChunkNetwork):
    """Predicts the noise in a flattened chunk and takes it out."""

    def __init__(self, config: DiffusionConfig, obs_size: int, action_size: int) -> None:
        super().__init__()
        self.config, self.shape, self.columns = config, (config.chunk, action_size), config.chunk * action_size
        self.denoiser = Denoiser(config.history * obs_size, self.columns, width=config.width, blocks=config.blocks)
        self.register_buffer("kept", squared_cosine(config.noise_steps), persistent=False)
        self._path = self._descent()
        draws = config.denoise_steps if config.sampler == "ddpm" else 1
        self.noise_size, self.redraws = draws * self.columns, config.redraw

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        actions, noise = hold_last(actions, valid), torch.randn_like(actions)
        step = torch.randint(1, self.config.noise_steps + 1, (len(obs), 1), device=obs.device)
        kept = self.get_buffer("kept")[step]
        noisy = kept.sqrt() * actions.flatten(1) + (1 - kept).sqrt() * noise.flatten(1)
        found = self.denoiser(noisy, step / self.config.noise_steps, self.denoiser.see(obs.flatten(1)))
        return functional.mse_loss(found.unflatten(-1, self.shape), noise), {}

    def forward(self, obs: Tensor, noise: Tensor | None = None) -> Tensor:
        noise = obs.new_zeros(len(obs), self.noise_size) if noise is None else noise
        x, *later = noise.split(self.columns, -1)
        seen, limit = self.denoiser.see(obs.flatten(1)), self.config.clip
        for i, (time, kept, kept_next) in enumerate(self._path):
            found = self.denoiser(x, obs.new_full((1, 1), time), seen)
            clean = ((x - (1 - kept) ** 0.5 * found) / kept**0.5).clamp(-limit, limit)
            found = (x - kept**0.5 * clean) / (1 - kept) ** 0.5
            spread = (1 - kept_next) / (1 - kept) * (1 - kept / kept_next) if later else 0.0
            x = kept_next**0.5 * clean + max(0.0, 1 - kept_next - spread) ** 0.5 * found
            x = x + spread**0.5 * later[i] if i < len(later) else x
        return x.unflatten(-1, self.shape)

    def _descent(self) -> list[tuple[float, float, float]]:
        """Return time, and what is kept of the signal there and one step on, from the noisiest step down to 0."""
        total, count = self.config.noise_steps, self.config.denoise_steps
        kept = squared_cosine(total).tolist()
        steps = [round(total * (count - i) / count) for i in range(count + 1)]
        return [(step / total, kept[step], kept[following]) for step, following in pairwise(steps)]


def squared_cosine(steps: int) -> Tensor:
    """Return which share A of the signal's variance is kept after 0, 1, .. ``steps`` steps, (steps + 1,)."""
    time = torch.arange(steps + 1, dtype=torch.float64) / steps
    ideal = torch.cos((time + OFFSET) / (1 + OFFSET) * torch.pi / 2) ** 2
    beta = torch.clamp(1 - ideal[1:] / ideal[:-1], max=LARGEST_BETA)
    return torch.cat([torch.ones(1, dtype=torch.float64), torch.cumprod(1 - beta, 0)]).float()
