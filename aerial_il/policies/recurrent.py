"""A recurrent network over the last observations: what has changed in them, and in which order, decides.

    h_i = LSTM(o_i, h_(i-1)) for i = t-To+1 .. t,    chunk = head(h_t)

It starts anew from the last ``history`` observations at every prediction, in training and in flight alike, so that it
never meets a memory longer than those it was trained on; what lies further back is lost. It sees its own past actions
in what they did, and can come to repeat them ("copycat") where a network without history would look at the scene.

Source: A. Mandlekar et al., "What Matters in Learning from Offline Human Demonstrations", 2021 (robomimic's BC-RNN:
sequences of 10, two LSTM layers of 400 units, mixture of 5 Gaussians). The defaults here are the size of one processor
core; ``policy=recurrent_robomimic`` are the paper's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from torch import Tensor, nn

from aerial_il.core.checks import require_choice, require_positive, require_share
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.heads import GaussianHead, Head, Loss, MixtureHead, PointHead
from aerial_il.policies.parts.network import ChunkNetwork, Encoder, PolicySettings
from aerial_il.policies.parts.normaliser import Scaling

Cell = Literal["lstm", "gru"]
End = Literal["point", "gaussian", "gmm"]
CELLS = {"lstm": nn.LSTM, "gru": nn.GRU}


@dataclass(frozen=True, kw_only=True)
class Recurrent(PolicySettings):
    """Sizes of the recurrent network and what stands at its end.

    Attributes:
        cell: ``lstm`` or ``gru``.
        units: width of each recurrent layer.
        layers: recurrent layers, one on top of the other.
        dropout: probability of dropping a unit between recurrent layers while training.
        head: ``point`` (one chunk), ``gaussian`` (with its deviation) or ``gmm`` (a mixture).
        loss: of the ``point`` head.
        modes, redraw: of the ``gmm`` head; see the policy ``gmm``.
        min_std: smallest deviation of the ``gaussian`` and ``gmm`` heads.
    """

    history: int = 10
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
    cell: Cell = "lstm"
    units: int = 128
    layers: int = 1
    dropout: float = 0.0
    head: End = "point"
    loss: Loss = "l1"
    modes: int = 5
    min_std: float = 0.05
    redraw: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, choices in (("cell", Cell), ("head", End), ("loss", Loss)):
            require_choice(self, name, choices)
        require_positive(self, "units", "layers", "modes", "min_std")
        require_share(self, "dropout", below_one=True)
        if self.dropout and self.layers == 1:
            raise InvalidValueError(f"dropout is {self.dropout}, but between layers, and there is one: set layers=2.")

    def build(self, obs_size: int, action_size: int) -> RecurrentNetwork:
        return RecurrentNetwork(self, obs_size, action_size)


class RecurrentNetwork(ChunkNetwork):
    """LSTM or GRU; the state after the present observation goes into the head."""

    def __init__(self, config: Recurrent, obs_size: int, action_size: int) -> None:
        super().__init__()
        cell = CELLS[config.cell]
        self.cell = cell(obs_size, config.units, config.layers, batch_first=True, dropout=config.dropout)
        self.head = _head(config, (config.chunk, action_size))
        self.noise_size, self.redraws = self.head.noise_size, config.redraw

    def forward(self, obs: Tensor, noise: Tensor | None = None) -> Tensor:
        return self.head(self._features(obs), noise)

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        return self.head.loss(self._features(obs), actions, valid)

    def _features(self, obs: Tensor) -> Tensor:
        return self.cell(obs)[0][:, -1]


def _head(config: Recurrent, shape: tuple[int, int]) -> Head:
    if config.head == "point":
        return PointHead(config.units, shape, config.loss)
    if config.head == "gaussian":
        return GaussianHead(config.units, shape, config.min_std)
    return MixtureHead(config.units, shape, config.modes, config.min_std)
