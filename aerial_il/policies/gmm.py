"""A perceptron with a mixture of Gaussians at its end: several ways of going on, one of which is flown.

    loss = -log sum_k pi_k(o) N(a; mu_k(o), diag sigma_k(o)^2),    flown: mu_k(o) with k drawn from pi(o)

A mode here is a whole chunk, so that its actions belong together. Which mode is drawn is decided anew for every chunk.
Decided once per episode (``redraw=false``) overlapping chunks always agree, but an unlucky choice, such as a mode that
dwells, is never left again. Components can die, for the one that starts nearest to the data takes all of it; more modes
than needed cost little.

The deviation is at least 0.05 here: over a chunk the likelihood multiplies, and with robomimic's 1e-4 elements that
hardly vary own the gradient (``policy=gmm_robomimic`` has it; 10 instead of 46 of 50 flights in a trial on ``reach``).

Source: A. Mandlekar et al., "What Matters in Learning from Offline Human Demonstrations", 2021 (robomimic): 5 modes,
deviation at least 1e-4, low-noise evaluation (there a deviation of 1e-4 around the mode's mean, here the mean).
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn

from aerial_il.policies.parts.heads import MixtureHead
from aerial_il.policies.parts.layers import check_layers, check_positive, hidden_layers
from aerial_il.policies.parts.network import ChunkNetwork, Encoder, PolicySettings
from aerial_il.policies.parts.normaliser import Scaling


@dataclass(frozen=True, kw_only=True)
class GMM(PolicySettings):
    """Sizes of the perceptron and of the mixture.

    Attributes:
        hidden: width of each hidden layer; each is followed by LayerNorm and GELU.
        dropout: probability of dropping a hidden unit while training.
        modes: Gaussians in the mixture.
        min_std: smallest deviation of a normalised action.
        redraw: draw the mode anew for each chunk rather than once per episode.
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
    modes: int = 5
    min_std: float = 0.05
    redraw: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_layers(self.hidden, self.dropout)
        check_positive(modes=self.modes, min_std=self.min_std)

    def build(self, obs_size: int, action_size: int) -> GMMNetwork:
        return GMMNetwork(self, obs_size, action_size)


class GMMNetwork(ChunkNetwork):
    """The perceptron of ``mlp`` with a mixture over chunks at its end."""

    def __init__(self, config: GMM, obs_size: int, action_size: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Flatten(), *hidden_layers(config.history * obs_size, config.hidden, config.dropout)
        )
        self.head = MixtureHead(config.hidden[-1], (config.chunk, action_size), config.modes, config.min_std)
        self.noise_size, self.redraws = self.head.noise_size, config.redraw

    def forward(self, obs: Tensor, noise: Tensor | None = None) -> Tensor:
        return self.head(self.body(obs), noise)

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        return self.head.loss(self.body(obs), actions, valid)
