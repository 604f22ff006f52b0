"""Flow matching: a network learns to carry noise to a demonstrated chunk along straight lines.

::

    training:  x_t = (1 - t) e + t a,    loss = |(a - e) - v_theta(x_t, t, o)|^2,    e ~ N(0, 1)
    flying:    x_0 = e,    x_(t + 1/N) = x_t + v_theta(x_t, t, o) / N,    a = x_1, limited to +-clip

The velocity holds the noise of every element of the chunk, which the network must reproduce beside the actions. With
``predict=sample`` it answers with the actions alone, and the velocity is what leads to them::

    loss = |a - a_theta(x_t, t, o)|^2,    v = (a_theta(x_t, t, o) - x_t) / (1 - t)
Times are drawn as t = s (1 - u) with u ~ Beta(1.5, 1), which dwells on noisy chunks, where the way is decided. Like
diffusion it follows one of several ways, in fewer steps for its paths are nearly straight.

Source: Y. Lipman et al., "Flow Matching for Generative Modeling", 2023; K. Black et al., "pi0: A Vision-Language-Action
Flow Model for General Robot Control", 2024, appendix B (velocity; times with s = 0.999, 10 Euler steps); T. Li, K. He,
"Back to Basics: Let Denoising Generative Models Denoise", 2025 (predicting the sample on the path of a flow).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import torch
from torch import Tensor

from aerial_il.core.checks import require_choice, require_positive
from aerial_il.policies.parts.denoiser import Denoiser
from aerial_il.policies.parts.guiding import Guide
from aerial_il.policies.parts.network import ChunkNetwork, Encoder, PolicySettings, squared_error, without_gaps
from aerial_il.policies.parts.normaliser import Scaling

Target = Literal["sample", "velocity"]
BETA, LATEST = 1.5, 0.999


@dataclass(frozen=True, kw_only=True)
class Flow(PolicySettings):
    """Sizes of the network and how a chunk is reached from noise.

    Attributes:
        width: of each hidden layer.
        blocks: residual blocks of two hidden layers each, after a first one.
        euler_steps: steps N from noise to a chunk.
        predict: what the network answers with: the ``velocity`` towards the actions, or the actions (``sample``).
        clip: limit of normalised actions at the end, in deviations of the data under ``standard`` scaling.
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
    euler_steps: int = 10
    predict: Target = "velocity"
    clip: float = 5.0
    redraw: bool = True

    holds_its_end: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice(self, "predict", Target)
        require_positive(self, "width", "blocks", "euler_steps", "clip")

    def build(self, obs_size: int, action_size: int) -> FlowNetwork:
        return FlowNetwork(self, obs_size, action_size)


class FlowNetwork(ChunkNetwork):
    """Tells where a flattened chunk on its way from noise is going, and goes there."""

    guided = True

    def __init__(self, config: Flow, obs_size: int, action_size: int) -> None:
        super().__init__()
        self.config, self.shape = config, (config.chunk, action_size)
        self.noise_size, self.redraws = config.chunk * action_size, config.redraw
        self.denoiser = Denoiser(config.history * obs_size, self.noise_size, width=config.width, blocks=config.blocks)

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        actions = without_gaps(actions, valid)
        noise, time = torch.randn_like(actions), some_times(obs)
        place = (1 - time) * noise.flatten(1) + time * actions.flatten(1)
        answer = self.denoiser(place, time, self.denoiser.see(obs.flatten(1))).unflatten(-1, self.shape)
        target = actions if self.config.predict == "sample" else actions - noise
        return squared_error(answer, target, valid), {}

    def forward(self, obs: Tensor, noise: Tensor | None = None, guide: Guide | None = None) -> Tensor:
        x = obs.new_zeros(obs.shape[0], self.noise_size) if noise is None else noise
        seen, steps = self.denoiser.see(obs.flatten(1)), self.config.euler_steps
        for i in range(steps):
            if guide:
                clean = guide(lambda x, i=i: self._clean(x, seen, i / steps), x, i / steps, 1 - i / steps)
                x = x + (clean - x) / (steps - i)
                continue
            answer = self.denoiser(x, obs.new_full((1, 1), i / steps), seen)
            x = x + ((answer - x) / (steps - i) if self.config.predict == "sample" else answer / steps)
        return x.clamp(-self.config.clip, self.config.clip).unflatten(-1, self.shape)

    def _clean(self, x: Tensor, seen: Tensor, time: float) -> Tensor:
        """Return the actions (B, C) that ``x`` (B, C) leads to."""
        answer = self.denoiser(x, seen.new_full((1, 1), time), seen)
        return answer if self.config.predict == "sample" else x + (1 - time) * answer


def some_times(obs: Tensor) -> Tensor:
    """Draw one time (B, 1) for each row of ``obs``; u ~ Beta(b, 1) is a uniform number to the power of 1/b."""
    uniform = torch.rand(obs.shape[0], 1, device=obs.device)
    return LATEST * (1 - uniform ** (1 / BETA))
