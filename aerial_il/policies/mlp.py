"""A perceptron from an observation history to a chunk of actions.

Predicting a chunk at once is what lets so plain a network fly a task with pauses: a single-step policy stalls where
the demonstrator waits. It fails where what to do next depends on what was done long before and shows nowhere.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn

from aerial_il.core.checks import require_choice, require_share, require_widths
from aerial_il.policies.parts.heads import DISTANCES, Loss, hidden_layers
from aerial_il.policies.parts.network import ChunkNetwork, Encoder, PolicySettings, masked_mean
from aerial_il.policies.parts.normaliser import Scaling


@dataclass(frozen=True, kw_only=True)
class MLP(PolicySettings):
    """Sizes and loss of the perceptron.

    Attributes:
        hidden: width of each hidden layer; each is followed by LayerNorm and GELU.
        dropout: probability of dropping a hidden unit while training.
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
    hidden: tuple[int, ...] = (256, 256)
    dropout: float = 0.0
    loss: Loss = "l1"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice(self, "loss", Loss)
        require_widths(self, "hidden")
        require_share(self, "dropout", below_one=True)

    def build(self, obs_size: int, action_size: int) -> MLPNetwork:
        return MLPNetwork(self, obs_size, action_size)


class MLPNetwork(ChunkNetwork):
    """Linear, LayerNorm, GELU for each hidden width, then one linear layer to all actions of the chunk."""

    def __init__(self, config: MLP, obs_size: int, action_size: int) -> None:
        super().__init__()
        hidden = hidden_layers(config.history * obs_size, config.hidden, config.dropout)
        last = nn.Linear(config.hidden[-1], config.chunk * action_size)
        self.layers = nn.Sequential(nn.Flatten(), *hidden, last)
        self.shape = (config.chunk, action_size)
        self.distance = DISTANCES[config.loss]

    def forward(self, obs: Tensor) -> Tensor:
        return self.layers(obs).unflatten(-1, self.shape)

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        return masked_mean(self.distance(self(obs), actions, reduction="none"), valid), {}
