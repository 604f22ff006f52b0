"""A perceptron that says how sure it is: the mean and deviation of every action of the chunk.

    loss = -log N(a; mu(o), diag sigma(o)^2),    flown: mu(o)

The deviation weighs the squared error, so that elements which cannot be predicted do not drown those that can, and it
tells where the demonstrations disagree. It is one mode only: between two ways round an obstacle it flies the mean. The
mean is learned slowly wherever the deviation is large.

Source: A. Mandlekar et al., "What Matters in Learning from Offline Human Demonstrations", 2021 (robomimic), whose
deviation is at least 0.007.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn

from aerial_il.policies.parts.heads import GaussianHead
from aerial_il.policies.parts.layers import check_layers, check_positive, hidden_layers
from aerial_il.policies.parts.network import ChunkNetwork, Encoder, PolicySettings
from aerial_il.policies.parts.normaliser import Scaling


@dataclass(frozen=True, kw_only=True)
class Gaussian(PolicySettings):
    """Sizes of the perceptron and its smallest deviation.

    Attributes:
        hidden: width of each hidden layer; each is followed by LayerNorm and GELU.
        dropout: probability of dropping a hidden unit while training.
        min_std: smallest deviation of a normalised action.
    """

    history: int = 1
    chunk: int = 20
    execute: int = 1
    ensemble: float | None = 0.01
    anchor: str | None = "ee_pos"
    relative: bool = False
    obs_names: tuple[str, ...] = ()
    blind_to: tuple[str, ...] = ("gripper", "wrist_force")
    images: tuple[str, ...] = ()
    encoder: Encoder = "cnn"
    image_features: int = 64
    crop: float = 0.9
    action_scaling: Scaling = "standard"
    obs_clip: float = 10.0
    hidden: tuple[int, ...] = (256, 256)
    dropout: float = 0.0
    min_std: float = 0.007

    def __post_init__(self) -> None:
        super().__post_init__()
        check_layers(self.hidden, self.dropout)
        check_positive(min_std=self.min_std)

    def build(self, obs_size: int, action_size: int) -> GaussianNetwork:
        return GaussianNetwork(self, obs_size, action_size)


class GaussianNetwork(ChunkNetwork):
    """The perceptron of ``mlp`` with a normal distribution at its end."""

    def __init__(self, config: Gaussian, obs_size: int, action_size: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Flatten(), *hidden_layers(config.history * obs_size, config.hidden, config.dropout)
        )
        self.head = GaussianHead(config.hidden[-1], (config.chunk, action_size), config.min_std)

    def forward(self, obs: Tensor) -> Tensor:
        return self.head(self.body(obs))

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        return self.head.loss(self.body(obs), actions, valid)
