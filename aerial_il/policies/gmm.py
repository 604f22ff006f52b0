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

from dataclasses import dataclass

from torch import nn

from aerial_il.core.checks import require_positive, require_share, require_widths
from aerial_il.policies.parts.heads import HeadedNetwork, MixtureHead, hidden_layers
from aerial_il.policies.parts.network import Encoder, PolicySettings
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
    masked_fields: tuple[str, ...] = ("gripper", "wrist_force")
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
        require_widths(self, "hidden")
        require_share(self, "dropout", below_one=True)
        require_positive(self, "modes", "min_std")

    def build(self, obs_size: int, action_size: int) -> HeadedNetwork:
        body = nn.Sequential(nn.Flatten(), *hidden_layers(self.history * obs_size, self.hidden, self.dropout))
        head = MixtureHead(self.hidden[-1], (self.chunk, action_size), self.modes, self.min_std)
        return HeadedNetwork(body, head, redraws=self.redraw)
