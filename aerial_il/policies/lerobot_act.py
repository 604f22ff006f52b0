"""lerobot's own ACT (action chunking transformer) as one of our policies, trained and flown by our commands.

The network and its loss are lerobot's; observations, normalisation, anchor, images and the execution of chunks are
ours, so that it differs from our other policies in nothing but the network. A policy that lerobot itself has trained
is flown by :mod:`.parts.lerobot_checkpoint` instead.

Source: T. Zhao et al., "Learning Fine-Grained Bimanual Manipulation with Low-Cost Hardware", 2023; lerobot 0.6. Its
defaults (width 512, feed-forward 3200, chunk 100) are made for a GPU; those here for a CPU.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from aerial_il.core.checks import require_not_negative, require_positive, require_share
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.lerobot_names import ACTION, ENVIRONMENT, STATE
from aerial_il.policies.parts.network import ChunkNetwork, Encoder, PolicySettings
from aerial_il.policies.parts.normaliser import Scaling

THEIRS = (
    "dim_model", "n_heads", "dim_feedforward", "n_encoder_layers", "n_decoder_layers", "n_vae_encoder_layers",
    "use_vae", "latent_dim", "kl_weight", "dropout",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class LerobotACT(PolicySettings):
    """Sizes of lerobot's ACT, under its own names.

    Attributes:
        dim_model: width of the transformer.
        n_heads: attention heads, a divisor of it.
        dim_feedforward: width between its attention layers.
        n_encoder_layers, n_decoder_layers, n_vae_encoder_layers: depths.
        use_vae: train a style variable, zero in flight.
        latent_dim: size of the style variable.
        kl_weight: how narrow the style variable is kept.
        dropout: while training.
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
    dim_model: int = 128
    n_heads: int = 4
    dim_feedforward: int = 256
    n_encoder_layers: int = 2
    n_decoder_layers: int = 1
    n_vae_encoder_layers: int = 2
    use_vae: bool = True
    latent_dim: int = 16
    kl_weight: float = 10.0
    dropout: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        require_share(self, "dropout", below_one=True)
        require_positive(self, "dim_model", "n_heads", "dim_feedforward", "n_encoder_layers", "n_decoder_layers")
        require_positive(self, "latent_dim")
        require_not_negative(self, "kl_weight")
        if self.dim_model % (2 * self.n_heads):
            raise InvalidValueError(f"dim_model is {self.dim_model}; it must be an even multiple of n_heads.")

    def build(self, obs_size: int, action_size: int) -> LerobotACTNetwork:
        return LerobotACTNetwork(self, obs_size, action_size)


class LerobotACTNetwork(ChunkNetwork):
    """lerobot's ``ACTPolicy`` over one flat vector, which it sees as state and as environment."""

    def __init__(self, config: LerobotACT, obs_size: int, action_size: int) -> None:
        super().__init__()
        from lerobot.configs import FeatureType, PolicyFeature
        from lerobot.policies.act.configuration_act import ACTConfig
        from lerobot.policies.act.modeling_act import ACTPolicy

        size = (config.history * obs_size,)
        inputs = {STATE: PolicyFeature(FeatureType.STATE, size), ENVIRONMENT: PolicyFeature(FeatureType.ENV, size)}
        self.policy = ACTPolicy(
            ACTConfig(
                input_features=inputs,
                output_features={ACTION: PolicyFeature(FeatureType.ACTION, (action_size,))},
                device="cpu",  # of the configuration alone: the trainer moves the network
                chunk_size=config.chunk,
                n_action_steps=config.chunk,
                **{name: getattr(config, name) for name in THEIRS},
            )
        )

    def forward(self, obs: Tensor) -> Tensor:
        return self.policy.model(_batch(obs))[0]

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        loss, logged = self.policy({**_batch(obs), ACTION: actions, "action_is_pad": valid < 0.5})
        return loss, {name: torch.tensor(value) for name, value in logged.items()}


def _batch(obs: Tensor) -> dict[str, Tensor]:
    vector = obs.flatten(1)
    return {STATE: vector, ENVIRONMENT: vector}
