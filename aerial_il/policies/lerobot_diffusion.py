"""lerobot's own diffusion policy (a 1-D U-Net) as one of our policies, trained and flown by our commands.

Network, noise schedule and loss are lerobot's; observations, normalisation, anchor, images and the execution of chunks
are ours. The noise that a chunk is denoised from is handed in (``policies/parts/noise.py``), and denoising adds no more
(DDIM). It needs the package ``diffusers``.

Source: C. Chi et al., "Diffusion Policy: Visuomotor Policy Learning via Action Diffusion", 2023; lerobot 0.6. Its
default width (512, 1024, 2048) is made for a GPU; the one here for a CPU.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass

import torch
from torch import Tensor

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.lerobot_names import ACTION, ENVIRONMENT, STATE
from aerial_il.policies.parts.network import ChunkNetwork, Encoder, PolicySettings, without_gaps
from aerial_il.policies.parts.normaliser import Scaling

THEIRS = (
    "down_dims", "kernel_size", "n_groups", "diffusion_step_embed_dim", "num_train_timesteps", "num_inference_steps",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class LerobotDiffusion(PolicySettings):
    """Sizes of lerobot's diffusion policy, under its own names.

    Attributes:
        down_dims: widths of the U-Net's levels; it sees the chunk rounded up to a multiple of 2 to their number.
        kernel_size: of its convolutions.
        n_groups: of its normalisation, a divisor of every width.
        diffusion_step_embed_dim: width of the encoded noise level.
        num_train_timesteps: noise levels.
        num_inference_steps: noise levels visited in flight.
    """

    history: int = 1
    chunk: int = 16
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
    action_scaling: Scaling = "minmax"
    obs_clip: float = 10.0
    down_dims: tuple[int, ...] = (64, 128)
    kernel_size: int = 5
    n_groups: int = 8
    diffusion_step_embed_dim: int = 64
    num_train_timesteps: int = 100
    num_inference_steps: int = 10

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.down_dims or any(width % self.n_groups for width in self.down_dims):
            raise InvalidValueError(f"down_dims is {self.down_dims}; each must be a multiple of {self.n_groups}.")
        if not 1 <= self.num_inference_steps <= self.num_train_timesteps:
            limit = self.num_train_timesteps
            raise InvalidValueError(f"num_inference_steps is {self.num_inference_steps}; it must lie in [1, {limit}].")

    @property
    def horizon(self) -> int:
        """The chunk, rounded up to what the U-Net can halve."""
        step = 2 ** len(self.down_dims)
        return -(-self.chunk // step) * step

    def build(self, obs_size: int, action_size: int) -> LerobotDiffusionNetwork:
        return LerobotDiffusionNetwork(self, obs_size, action_size)


class LerobotDiffusionNetwork(ChunkNetwork):
    """lerobot's ``DiffusionPolicy`` conditioned on one flat vector."""

    def __init__(self, config: LerobotDiffusion, obs_size: int, action_size: int) -> None:
        super().__init__()
        if importlib.util.find_spec("diffusers") is None:
            raise InvalidValueError("policy=lerobot_diffusion needs a package: pip install 'lerobot[diffusion]'")
        from lerobot.configs import FeatureType, PolicyFeature
        from lerobot.policies.diffusion.configuration_diffusion import DiffusionConfig
        from lerobot.policies.diffusion.modeling_diffusion import DiffusionPolicy

        size = (config.history * obs_size,)
        inputs = {STATE: PolicyFeature(FeatureType.STATE, size), ENVIRONMENT: PolicyFeature(FeatureType.ENV, (1,))}
        self.chunk = config.chunk
        self.policy = DiffusionPolicy(
            DiffusionConfig(
                input_features=inputs,  # lerobot wants an environment: one that tells nothing
                output_features={ACTION: PolicyFeature(FeatureType.ACTION, (action_size,))},
                device="cpu",  # of the configuration alone: the trainer moves the network
                n_obs_steps=1,
                horizon=config.horizon,
                n_action_steps=config.chunk,
                noise_scheduler_type="DDIM",
                **{name: getattr(config, name) for name in THEIRS},
                do_mask_loss_for_padding=True,
            )
        )
        self.shape = (config.horizon, action_size)
        self.noise_size = config.horizon * action_size

    def forward(self, obs: Tensor, noise: Tensor | None = None) -> Tensor:
        start = obs.new_zeros(obs.shape[0], self.noise_size) if noise is None else noise.clone()
        return self.policy.diffusion.generate_actions(_batch(obs), noise=start.unflatten(1, self.shape))

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        missing, actions = self.policy.config.horizon - self.chunk, without_gaps(actions, valid)
        actions = torch.cat([actions, actions[:, -1:].expand(-1, missing, -1)], dim=1)
        padding = torch.cat([valid < 0.5, valid.new_ones(len(valid), missing) > 0], dim=1)
        loss, _ = self.policy({**_batch(obs), ACTION: actions, "action_is_pad": padding})
        return loss, {}


def _batch(obs: Tensor) -> dict[str, Tensor]:
    """Return the vector (B, 1, D) as state, and the environment that tells nothing (B, 1, 1)."""
    return {STATE: obs.flatten(1)[:, None], ENVIRONMENT: obs.new_zeros(obs.shape[0], 1, 1)}
