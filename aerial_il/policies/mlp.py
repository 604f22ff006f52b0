"""A perceptron from an observation history to a chunk of actions.

Predicting a chunk at once is what lets so plain a network fly a task with pauses: a single-step policy stalls where
the demonstrator waits. It fails where what to do next depends on what was done long before and shows nowhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, get_args

from torch import Tensor, nn
from torch.nn import functional

from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.network import ChunkNetwork, PolicyConfig, masked_mean

Loss = Literal["l1", "l2", "huber"]
DISTANCES: dict[str, Callable[..., Tensor]] = {
    "l1": functional.l1_loss,
    "l2": functional.mse_loss,
    "huber": functional.smooth_l1_loss,
}


@dataclass(frozen=True, kw_only=True)
class MlpConfig(PolicyConfig):
    """Sizes and loss of the perceptron.

    Attributes:
        hidden: width of each hidden layer; each is followed by LayerNorm and GELU.
        dropout: probability of dropping a hidden unit while training.
        loss: distance between predicted and demonstrated actions, both normalised.
    """

    hidden: tuple[int, ...] = (256, 256)
    dropout: float = 0.0
    loss: Loss = "l1"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.loss not in get_args(Loss):
            raise InvalidValueError(f"Unknown loss {self.loss!r}. Valid: {', '.join(get_args(Loss))}.")
        if not self.hidden or min(self.hidden) < 1:
            raise InvalidValueError(f"hidden is {self.hidden}; it must name at least one positive width.")
        if not 0 <= self.dropout < 1:
            raise InvalidValueError(f"dropout is {self.dropout}; it must lie in [0, 1).")

    def build(self, obs_size: int, action_size: int) -> Mlp:
        return Mlp(self, obs_size, action_size)


class Mlp(ChunkNetwork):
    """Linear, LayerNorm, GELU for each hidden width, then one linear layer to all actions of the chunk."""

    def __init__(self, config: MlpConfig, obs_size: int, action_size: int) -> None:
        super().__init__()
        widths = (config.history * obs_size, *config.hidden)
        hidden = [_layer(a, b, config.dropout) for a, b in pairwise(widths)]
        self.layers = nn.Sequential(nn.Flatten(), *hidden, nn.Linear(widths[-1], config.chunk * action_size))
        self.shape = (config.chunk, action_size)
        self.distance = DISTANCES[config.loss]

    def forward(self, obs: Tensor) -> Tensor:
        return self.layers(obs).unflatten(-1, self.shape)

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        return masked_mean(self.distance(self(obs), actions, reduction="none"), valid), {}


def _layer(inputs: int, outputs: int, dropout: float) -> nn.Sequential:
    parts: list[nn.Module] = [nn.Linear(inputs, outputs), nn.LayerNorm(outputs), nn.GELU()]
    return nn.Sequential(*parts, *([nn.Dropout(dropout)] if dropout else []))
