"""ACT: a transformer that plans a chunk for a style of doing it, and a style that training reads off the chunk.

::

    training:  z ~ q(z | o, a) = N(mu, diag sigma^2),    loss = |a - pi(o, z)| + w KL(q || N(0, 1))
    flying:    a = pi(o, 0), overlapping chunks averaged with weights exp(-m i), oldest first

The style z shall take up in what demonstrators differ, so that pi need not average over it. With the paper's w = 10 it
hardly takes up anything: a nat of KL costs more than the L1 loss of all that it could tell, so expect one mode and
rely on chunks and ensembling; ``kl_weight`` well below 1 together with ``sample_latent`` gives several. It goes on
improving long after its loss seems flat, and is the slowest of the policies to train on a processor.

Source: T. Zhao et al., "Learning Fine-Grained Bimanual Manipulation with Low-Cost Hardware", 2023, section IV and
appendix C. One decoder layer, for the published code uses the first of its seven only. Layers normalise their input
("pre-norm"), which trains at ordinary learning rates, where the paper normalises their output and takes 1e-5. The
defaults are the size of one processor core; ``policy=act_paper`` has the paper's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from aerial_il.core.checks import require_choice, require_not_negative, require_positive, require_share
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.heads import DISTANCES, Loss
from aerial_il.policies.parts.network import ChunkNetwork, Encoder, PolicySettings, masked_mean
from aerial_il.policies.parts.normaliser import Scaling


@dataclass(frozen=True, kw_only=True)
class ACT(PolicySettings):
    """Sizes of the transformer and weight of its latent variable.

    Attributes:
        width: of each token.
        heads: of attention.
        feedforward: width between the two linear maps of a layer.
        encoder_layers: over what is seen, and again in the network that reads the style off a chunk.
        decoder_layers: from what is seen to the chunk.
        latent: numbers in the style z.
        kl_weight: of the KL divergence, summed over z, beside the mean distance.
        sample_latent: fly with a style drawn once per episode instead of z = 0.
        dropout: probability of dropping a unit while training.
        loss: distance between predicted and demonstrated actions, both normalised.
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
    width: int = 128
    heads: int = 4
    feedforward: int = 256
    encoder_layers: int = 1
    decoder_layers: int = 1
    latent: int = 32
    kl_weight: float = 10.0
    sample_latent: bool = False
    dropout: float = 0.1
    loss: Loss = "l1"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice(self, "loss", Loss)
        require_share(self, "dropout", below_one=True)
        require_positive(self, "width", "heads", "feedforward", "latent", "encoder_layers", "decoder_layers")
        require_not_negative(self, "kl_weight")
        if self.width % self.heads:
            raise InvalidValueError(f"width is {self.width}; it must be a multiple of heads, {self.heads}.")

    def build(self, obs_size: int, action_size: int) -> ACTNetwork:
        return ACTNetwork(self, obs_size, action_size)


class ACTNetwork(ChunkNetwork):
    """Tokens in: the style and each observation. Tokens out: one for each action of the chunk."""

    def __init__(self, config: ACT, obs_size: int, action_size: int) -> None:
        super().__init__()
        self.config, self.distance = config, DISTANCES[config.loss]
        self.noise_size = config.latent if config.sample_latent else 0
        self.see = nn.Linear(obs_size, config.width)
        self.hear = nn.Linear(config.latent, config.width)
        self.encoder = _encoder(config)
        self.decoder = nn.TransformerDecoder(
            nn.TransformerDecoderLayer(**_layer(config)), config.decoder_layers, nn.LayerNorm(config.width)
        )
        self.last = nn.Linear(config.width, action_size)
        self.places = _tokens(1 + config.history, config.width)
        self.queries = _tokens(config.chunk, config.width)
        self.style = _Style(config, obs_size, action_size)

    def forward(self, obs: Tensor, noise: Tensor | None = None) -> Tensor:
        return self._plan(obs, obs.new_zeros(obs.shape[0], self.config.latent) if noise is None else noise)

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        mean, log_std = self.style(obs, actions, valid)
        planned = self._plan(obs, mean + log_std.exp() * torch.randn_like(mean))
        error = masked_mean(self.distance(planned, actions, reduction="none"), valid)
        kl = 0.5 * (mean**2 + (2 * log_std).exp() - 1 - 2 * log_std).sum(-1).mean()
        return error + self.config.kl_weight * kl, {"distance": error.detach(), "kl": kl.detach()}

    def _plan(self, obs: Tensor, latent: Tensor) -> Tensor:
        tokens = torch.cat([self.hear(latent)[:, None], self.see(obs)], 1)
        memory = self.encoder(tokens + self.places)
        return self.last(self.decoder(self.queries.expand(obs.shape[0], -1, -1), memory))


class _Style(nn.Module):
    """Reads the style (mean and log deviation, each (B, Z)) off an observation and the chunk that followed it."""

    def __init__(self, config: ACT, obs_size: int, action_size: int) -> None:
        super().__init__()
        self.see, self.act = nn.Linear(obs_size, config.width), nn.Linear(action_size, config.width)
        self.places = _tokens(2 + config.chunk, config.width)  # the first one is where the answer appears
        self.encoder = _encoder(config)
        self.last = nn.Linear(config.width, 2 * config.latent)

    def forward(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, Tensor]:
        now = self.see(obs[:, -1:])
        tokens = torch.cat([torch.zeros_like(now), now, self.act(actions)], 1) + self.places
        ignored = torch.cat([torch.zeros_like(valid[:, :1]).expand(-1, 2), 1 - valid], 1) > 0.5
        mean, log_std = self.last(self.encoder(tokens, src_key_padding_mask=ignored)[:, 0]).chunk(2, -1)
        return mean, log_std


def _encoder(config: ACT) -> nn.TransformerEncoder:
    layer = nn.TransformerEncoderLayer(**_layer(config))
    norm = nn.LayerNorm(config.width)
    return nn.TransformerEncoder(layer, config.encoder_layers, norm, enable_nested_tensor=False)


def _layer(config: ACT) -> dict[str, Any]:
    sizes = {"d_model": config.width, "nhead": config.heads, "dim_feedforward": config.feedforward}
    return {**sizes, "dropout": config.dropout, "batch_first": True, "norm_first": True}


def _tokens(count: int, width: int) -> nn.Parameter:
    return nn.Parameter(torch.randn(count, width) * 0.02)
