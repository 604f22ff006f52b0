"""A Gaussian whose samples a tanh squashes into the action's bounds: what reinforcement learning explores with.

Trained by maximum likelihood it is also a stochastic imitator. Flown, it is deterministic: it takes the mean action,
the tanh of the Gaussian's mean.

Source: T. Haarnoja et al., "Soft Actor-Critic Algorithms and Applications", 2018, appendix C.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from aerial_il.core.checks import require_choice, require_widths
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.network import Encoder, PolicySettings, StochasticNetwork, masked_mean
from aerial_il.policies.parts.normaliser import Scaling

Activation = Literal["relu", "tanh"]
Spread = Literal["state", "free"]
ACTIVATIONS: dict[str, type[nn.Module]] = {"relu": nn.ReLU, "tanh": nn.Tanh}
LOG_STD_LOW, LOG_STD_HIGH = -5.0, 2.0
EDGE = 1.0 - 1e-4  # demonstrated actions are pulled this far inside: at the bound itself the pre-tanh value is infinite


@dataclass(frozen=True, kw_only=True)
class SquashedGaussian(PolicySettings):
    """Sizes of the network and form of its standard deviation.

    Attributes:
        hidden: width of each hidden layer.
        activation: between them, ``relu`` or ``tanh``.
        spread: ``state``, a standard deviation that depends on the observation; or ``free``, one number for each action
            element.
        log_std: log standard deviation of pre-tanh samples before training, in normalised actions.
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
    hidden: tuple[int, ...] = (256, 256)
    activation: Activation = "relu"
    spread: Spread = "state"
    log_std: float = -0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        require_widths(self, "hidden")
        require_choice(self, "activation", Activation)
        require_choice(self, "spread", Spread)
        if not LOG_STD_LOW < self.log_std < LOG_STD_HIGH:
            raise InvalidValueError(f"log_std is {self.log_std}; it must lie in ({LOG_STD_LOW:g}, {LOG_STD_HIGH:g}).")

    def build(self, obs_size: int, action_size: int) -> SquashedGaussianNetwork:
        return SquashedGaussianNetwork(self, obs_size, action_size)


class SquashedGaussianNetwork(StochasticNetwork):
    """A perceptron to the mean and log standard deviation of a Gaussian pre-tanh ``u``; the action is ``tanh(u)``."""

    def __init__(self, config: SquashedGaussian, obs_size: int, action_size: int) -> None:
        super().__init__()
        widths = (config.history * obs_size, *config.hidden)
        activation, outputs = ACTIVATIONS[config.activation], config.chunk * action_size
        layers = [part for a, b in pairwise(widths) for part in (nn.Linear(a, b), activation())]
        self.trunk = nn.Sequential(nn.Flatten(), *layers)
        self.mean = nn.Linear(widths[-1], outputs)
        self.log_std = nn.Linear(widths[-1], outputs) if config.spread == "state" else None
        self.free = nn.Parameter(torch.full((outputs,), config.log_std)) if self.log_std is None else None
        self.shape = (config.chunk, action_size)
        with torch.no_grad():
            self.mean.weight.mul_(0.1)  # a first policy that acts near the centre of the bounds everywhere
            if self.log_std is not None:
                self.log_std.weight.mul_(0.1)
                self.log_std.bias.fill_(config.log_std)

    def forward(self, obs: Tensor) -> Tensor:
        return torch.tanh(self.mean(self.trunk(obs))).unflatten(-1, self.shape)

    def gaussian(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """Return mean and log standard deviation (B, Ta * Da) before the tanh, for ``obs`` (B, To, Do)."""
        hidden = self.trunk(obs)
        mean = self.mean(hidden)
        if self.log_std is not None:
            log_std = self.log_std(hidden)
        else:
            assert self.free is not None
            log_std = self.free.expand_as(mean)
        return mean, log_std.clamp(LOG_STD_LOW, LOG_STD_HIGH)

    def distribution(self, obs: Tensor) -> tuple[Tensor, ...]:
        return self.gaussian(obs)

    def sample(self, obs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Sample actions, differentiably.

        Returns:
            Actions in (-1, 1) and their pre-tanh samples, both (B, Ta * Da), and the log density of the actions (B,).
        """
        mean, log_std = self.gaussian(obs)
        raw = mean + log_std.exp() * torch.randn_like(mean)
        return torch.tanh(raw), raw, log_density(raw, mean, log_std).sum(-1)

    def judge(self, obs: Tensor, drawn: Tensor) -> tuple[Tensor, Tensor]:
        """Return log densities (B,) of actions by their pre-tanh samples (B, Ta * Da), and Gaussian entropies (B,)."""
        mean, log_std = self.gaussian(obs)
        return log_density(drawn, mean, log_std).sum(-1), log_std.sum(-1)

    def divergence(self, of: tuple[Tensor, ...], against: tuple[Tensor, ...]) -> Tensor:
        """Return KL divergences (B,) of the Gaussians, which the tanh leaves as they are."""
        (mean, log_std), (other, other_log_std) = of, against
        spread = ((2 * log_std).exp() + (mean - other) ** 2) / (2 * (2 * other_log_std).exp())
        return (other_log_std - log_std + spread - 0.5).sum(-1)

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        mean, log_std = self.gaussian(obs)
        raw = unsquashed(actions).flatten(1)
        surprise = -log_density(raw, mean, log_std).unflatten(-1, self.shape)
        return masked_mean(surprise, valid), {"deviation": log_std.detach().exp().mean()}


def unsquashed(actions: Tensor) -> Tensor:
    """Return the pre-tanh values of ``actions`` (...), those at the bounds pulled a little inside."""
    return torch.atanh(actions.clamp(-EDGE, EDGE))


def log_density(raw: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
    """Return the log density of ``tanh(raw)``, element by element, for a Gaussian pre-tanh sample ``raw``.

    The tanh's part, ``log(1 - tanh(u)^2)``, is written as ``2 (log 2 - u - softplus(-2 u))``, which no u overflows.
    """
    gaussian = -0.5 * (((raw - mean) / log_std.exp()) ** 2 + math.log(2 * math.pi)) - log_std
    return gaussian - 2.0 * (math.log(2.0) - raw - functional.softplus(-2.0 * raw))
