"""A score for each discrete action, of which the highest is flown: logits of a distribution, or action values.

Among several actions an environment with discrete actions takes the one with the highest score, an action of as many
elements (:mod:`aerial_il.suite.outside.gymnasium_world`); the discrete actions are then one-hot vectors. Where actions
are vectors, the discrete ones can be the middle of the bounds and each element alone at either of its bounds.

Trained by maximum likelihood it imitates the demonstrator; a demonstrated action counts as the discrete action nearest
to it.

Source, of ``dueling``: Z. Wang et al., "Dueling Network Architectures for Deep Reinforcement Learning", 2016,
equation 9.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor, nn

from aerial_il.core.checks import require_choice, require_widths
from aerial_il.policies.parts.network import Encoder, PolicySettings, StochasticNetwork, masked_mean
from aerial_il.policies.parts.normaliser import Scaling
from aerial_il.policies.squashed_gaussian import ACTIVATIONS, Activation

Choices = Literal["one_hot", "bounds"]


@dataclass(frozen=True, kw_only=True)
class Categorical(PolicySettings):
    """Sizes of the network and what it chooses among.

    Attributes:
        hidden: width of each hidden layer.
        activation: between them, ``relu`` or ``tanh``.
        choices: the discrete actions, ``one_hot``, one of the elements; or ``bounds``, the middle or one element at
            either bound.
        dueling: scores are the value of the state plus each action's advantage over their mean.
    """

    history: int = 1
    chunk: int = 1
    execute: int = 1
    ensemble: float | None = None
    anchor: str | None = None
    relative: bool = False
    obs_names: tuple[str, ...] = ()
    masked_fields: tuple[str, ...] = ()
    images: tuple[str, ...] = ()
    encoder: Encoder = "cnn"
    image_features: int = 64
    crop: float = 0.9
    action_scaling: Scaling = "minmax"
    obs_clip: float = 10.0
    hidden: tuple[int, ...] = (64, 64)
    activation: Activation = "tanh"
    choices: Choices = "one_hot"
    dueling: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        require_widths(self, "hidden")
        require_choice(self, "activation", Activation)
        require_choice(self, "choices", Choices)

    def build(self, obs_size: int, action_size: int) -> CategoricalNetwork:
        return CategoricalNetwork(self, obs_size, action_size)


class CategoricalNetwork(StochasticNetwork):
    """A perceptron to the scores of K discrete actions; a sample is the index of one."""

    table: Tensor  # (K, Da) normalised actions

    def __init__(self, config: Categorical, obs_size: int, action_size: int) -> None:
        super().__init__()
        table = one_hot(action_size) if config.choices == "one_hot" else at_bounds(action_size)
        self.register_buffer("table", table)
        widths = (config.history * obs_size, *config.hidden)
        layers = [part for a, b in pairwise(widths) for part in (nn.Linear(a, b), ACTIVATIONS[config.activation]())]
        self.trunk = nn.Sequential(nn.Flatten(), *layers)
        self.advantages = nn.Linear(widths[-1], config.chunk * len(table))
        self.value = nn.Linear(widths[-1], config.chunk) if config.dueling else None
        self.shape = (config.chunk, len(table))
        with torch.no_grad():
            self.advantages.weight.mul_(0.1)  # a first policy that is nearly uniform

    def scores(self, obs: Tensor) -> Tensor:
        """Return scores (B, Ta, K) for ``obs`` (B, To, Do)."""
        hidden = self.trunk(obs)
        scores = self.advantages(hidden).unflatten(-1, self.shape)
        if self.value is None:
            return scores
        return self.value(hidden)[..., None] + scores - scores.mean(-1, keepdim=True)

    def forward(self, obs: Tensor) -> Tensor:
        return self.table[self.scores(obs).argmax(-1)]

    def distribution(self, obs: Tensor) -> tuple[Tensor, ...]:
        return (torch.log_softmax(self.scores(obs), -1),)

    def sample(self, obs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        (log_prob,) = self.distribution(obs)
        drawn = torch.multinomial(log_prob.exp().flatten(0, 1), 1).unflatten(0, log_prob.shape[:2])
        chosen = log_prob.gather(-1, drawn)[..., 0]
        return self.table[drawn[..., 0]].flatten(1), drawn[..., 0].float(), chosen.sum(-1)

    def judge(self, obs: Tensor, drawn: Tensor) -> tuple[Tensor, Tensor]:
        (log_prob,) = self.distribution(obs)
        chosen = log_prob.gather(-1, drawn.long()[..., None])[..., 0]
        return chosen.sum(-1), -(log_prob.exp() * log_prob).sum((-1, -2))

    def divergence(self, of: tuple[Tensor, ...], against: tuple[Tensor, ...]) -> Tensor:
        return (of[0].exp() * (of[0] - against[0])).sum((-1, -2))

    def nearest(self, actions: Tensor) -> Tensor:
        """Return the indices (...) of the discrete actions that normalised ``actions`` (..., Da) are nearest to."""
        return ((actions[..., None, :] - self.table) ** 2).sum(-1).argmin(-1)

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        (log_prob,) = self.distribution(obs)
        surprise = -log_prob.gather(-1, self.nearest(actions)[..., None])
        right = (log_prob.argmax(-1) == self.nearest(actions))[..., None].float()
        return masked_mean(surprise, valid), {"accuracy": masked_mean(right, valid)}


def one_hot(size: int) -> Tensor:
    """Return the normalised actions (Da, Da) with one element at its upper bound and all others at their lower."""
    return 2.0 * torch.eye(size) - 1.0


def at_bounds(size: int) -> Tensor:
    """Return the normalised actions (2 Da + 1, Da) in the middle, and with one element at either bound."""
    return torch.cat([torch.zeros(1, size), torch.eye(size), -torch.eye(size)])
