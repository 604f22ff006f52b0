"""A perceptron that says how sure it is: the mean and deviation of every action of the chunk.

    loss = -log N(a; mu(o), diag sigma(o)^2),    flown: mu(o)

The deviation weighs the squared error, so that elements which cannot be predicted do not drown those that can, and it
tells where the demonstrations disagree. It is one mode only: between two ways round an obstacle it flies the mean. The
mean is learned slowly wherever the deviation is large.

Source: A. Mandlekar et al., "What Matters in Learning from Offline Human Demonstrations", 2021 (robomimic), whose
deviation is at least 0.007.
"""

from dataclasses import dataclass

from torch import nn

from aerial_il.core.checks import require_positive, require_share, require_widths
from aerial_il.policies.parts.heads import GaussianHead, HeadedNetwork, hidden_layers
from aerial_il.policies.parts.network import Encoder, PolicySettings
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
    masked_fields: tuple[str, ...] = ("gripper", "wrist_force")
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
        require_widths(self, "hidden")
        require_share(self, "dropout", below_one=True)
        require_positive(self, "min_std")

    def build(self, obs_size: int, action_size: int) -> HeadedNetwork:
        body = nn.Sequential(nn.Flatten(), *hidden_layers(self.history * obs_size, self.hidden, self.dropout))
        return HeadedNetwork(body, GaussianHead(self.hidden[-1], (self.chunk, action_size), self.min_std))
