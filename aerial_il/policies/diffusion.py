"""Diffusion: the chunk is what is left when a network has taken the noise out of noise, step by step.

::

    training:  x_t = sqrt(A_t) a + sqrt(1 - A_t) e,    loss = |y - f_theta(x_t, t, o)|^2,    e ~ N(0, 1), t uniform
    flying:    a_hat = what f_theta(x_t, t, o) says of a, limited to +-clip;
               x_s = sqrt(A_s) a_hat + sqrt(1 - A_s - v) e_hat + sqrt(v) z,    from x_T ~ N(0, 1) down to x_0 = a_hat

with A_t the squared-cosine schedule, e_hat the noise that belongs to a_hat, and v = 0 (``ddim``) or the posterior
variance (``ddpm``). The network answers with y = a (``sample``), e (``noise``) or sqrt(A_t) e - sqrt(1 - A_t) a
(``velocity``). Few steps of a small network leave an error in every answer; a sample carries it as it is, whereas noise
hands it on divided by sqrt(A_t), which is 400 times as much at the noisiest of 20 steps.

It can follow any of several ways that the demonstrations show. Noise is drawn anew for every chunk; under ``ddim`` and
with the noise kept for an episode (``redraw=false``) it stays on the way that it began, even if that leads nowhere.

Source: C. Chi et al., "Diffusion Policy", 2023 (chunks from noise, clip); Y. Ze et al., "3D Diffusion Policy", 2024
(sample instead of noise); T. Salimans, J. Ho, "Progressive Distillation", 2022, section 4 (velocity); A. Nichol,
P. Dhariwal, "Improved Denoising Diffusion Probabilistic Models", 2021, eq. 17 (schedule); J. Song et al., "Denoising
Diffusion Implicit Models", 2021, eq. 12 (both samplers); A. Ren et al., "DPPO", 2024 (size for a processor: 512 x 3,
20 steps).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, Literal

import torch
from torch import Tensor

from aerial_il.core.checks import require_choice, require_positive
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.denoiser import Denoiser
from aerial_il.policies.parts.guiding import Guide
from aerial_il.policies.parts.network import ChunkNetwork, Encoder, PolicySettings, squared_error, without_gaps
from aerial_il.policies.parts.normaliser import Scaling

Sampler = Literal["ddim", "ddpm"]
Target = Literal["noise", "sample", "velocity"]
OFFSET, LARGEST_BETA = 0.008, 0.999


@dataclass(frozen=True, kw_only=True)
class Diffusion(PolicySettings):
    """Sizes of the network, the schedule and how it is run backwards.

    Attributes:
        width: of each hidden layer.
        blocks: residual blocks of two hidden layers each, after a first one.
        noise_steps: steps of the schedule.
        denoise_steps: how many of them are taken when flying, evenly chosen.
        sampler: ``ddim`` (noise at the start only) or ``ddpm`` (at every step).
        predict: what the network answers with: the actions (``sample``), their ``noise`` or a ``velocity``.
        clip: limit of normalised actions while denoising, in deviations of the data under ``standard`` scaling; 1 is
            the range of the data under ``minmax``.
        redraw: draw noise anew for each chunk rather than once per episode.
    """

    history: int = 1
    chunk: int = 20
    execute: int = 1
    ensemble: float | None = 0.01
    anchor: str | None = "ee_pos"
    relative: bool = False
    obs_names: tuple[str, ...] = ()
    masked_fields: tuple[str, ...] = ("gripper", "wrist_force")
    images: tuple[str, ...] = ()
    encoder: Encoder = "cnn"
    image_features: int = 64
    crop: float = 0.9
    action_scaling: Scaling = "standard"
    obs_clip: float = 10.0
    width: int = 512
    blocks: int = 1
    noise_steps: int = 20
    denoise_steps: int = 10
    sampler: Sampler = "ddim"
    predict: Target = "sample"
    clip: float = 10.0
    redraw: bool = True

    holds_its_end: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice(self, "sampler", Sampler)
        require_choice(self, "predict", Target)
        require_positive(self, "width", "blocks", "noise_steps", "clip")
        if not 1 <= self.denoise_steps <= self.noise_steps:
            raise InvalidValueError(
                f"denoise_steps is {self.denoise_steps}; it must lie in [1, {self.noise_steps}], that is noise_steps."
            )

    def build(self, obs_size: int, action_size: int) -> DiffusionNetwork:
        return DiffusionNetwork(self, obs_size, action_size)


class DiffusionNetwork(ChunkNetwork):
    """Tells signal from noise in a flattened chunk and takes the noise out."""

    guided = True

    def __init__(self, config: Diffusion, obs_size: int, action_size: int) -> None:
        super().__init__()
        self.config, self.shape, self.columns = config, (config.chunk, action_size), config.chunk * action_size
        self.denoiser = Denoiser(config.history * obs_size, self.columns, width=config.width, blocks=config.blocks)
        self.register_buffer("kept", squared_cosine(config.noise_steps), persistent=False)
        self._path = self._descent()
        draws = config.denoise_steps if config.sampler == "ddpm" else 1
        self.noise_size, self.redraws = draws * self.columns, config.redraw

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        actions = without_gaps(actions, valid)
        noise = torch.randn_like(actions)
        step = torch.randint(1, self.config.noise_steps + 1, (obs.shape[0], 1), device=obs.device)
        kept = self.get_buffer("kept")[step]
        noisy = kept.sqrt() * actions.flatten(1) + (1 - kept).sqrt() * noise.flatten(1)
        answer = self.denoiser(noisy, step / self.config.noise_steps, self.denoiser.see(obs.flatten(1)))
        target = self._target(actions.flatten(1), noise.flatten(1), kept)
        return squared_error(answer.unflatten(-1, self.shape), target.unflatten(-1, self.shape), valid), {}

    def forward(self, obs: Tensor, noise: Tensor | None = None, guide: Guide | None = None) -> Tensor:
        noise = obs.new_zeros(obs.shape[0], self.noise_size) if noise is None else noise
        x, *later = noise.split(self.columns, -1)
        seen, limit = self.denoiser.see(obs.flatten(1)), self.config.clip
        for i, (time, kept, kept_next) in enumerate(self._path):

            def denoise(x: Tensor, time: float = time, kept: float = kept) -> Tensor:
                answer = self.denoiser(x, obs.new_full((1, 1), time), seen)
                return self._clean(x, answer, kept).clamp(-limit, limit)

            clean = guide(denoise, x, kept**0.5, (1 - kept) ** 0.5) if guide else denoise(x)
            removed = (x - kept**0.5 * clean) / (1 - kept) ** 0.5
            spread = (1 - kept_next) / (1 - kept) * (1 - kept / kept_next) if later else 0.0
            x = kept_next**0.5 * clean + max(0.0, 1 - kept_next - spread) ** 0.5 * removed
            x = x + spread**0.5 * later[i] if i < len(later) else x
        return x.unflatten(-1, self.shape)

    def _target(self, actions: Tensor, noise: Tensor, kept: Tensor) -> Tensor:
        """Return what the network should answer where a share ``kept`` (B, 1) of the signal is left."""
        match self.config.predict:
            case "noise":
                return noise
            case "sample":
                return actions
            case "velocity":
                return kept.sqrt() * noise - (1 - kept).sqrt() * actions

    def _clean(self, x: Tensor, answer: Tensor, kept: float) -> Tensor:
        """Return the actions (B, C) that belong to the network's ``answer`` for ``x``."""
        match self.config.predict:
            case "noise":
                return (x - (1 - kept) ** 0.5 * answer) / kept**0.5
            case "sample":
                return answer
            case "velocity":
                return kept**0.5 * x - (1 - kept) ** 0.5 * answer

    def _descent(self) -> list[tuple[float, float, float]]:
        """Return time, and what is kept of the signal there and one step on, from the noisiest step down to 0."""
        total, count = self.config.noise_steps, self.config.denoise_steps
        kept = squared_cosine(total).tolist()
        steps = [round(total * (count - i) / count) for i in range(count + 1)]
        return [(step / total, kept[step], kept[following]) for step, following in pairwise(steps)]


def squared_cosine(steps: int) -> Tensor:
    """Return which share A of the signal's variance is kept after 0, 1, .. ``steps`` steps, (steps + 1,)."""
    time = torch.arange(steps + 1, dtype=torch.float64, device="cpu") / steps
    ideal = torch.cos((time + OFFSET) / (1 + OFFSET) * torch.pi / 2) ** 2
    beta = torch.clamp(1 - ideal[1:] / ideal[:-1], max=LARGEST_BETA)
    return torch.cat([torch.ones(1, dtype=torch.float64, device="cpu"), torch.cumprod(1 - beta, 0)]).float()
