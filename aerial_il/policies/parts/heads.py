"""Hidden layers of a perceptron, and ends of a network: chunks of actions, or distributions over them, with a loss."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from aerial_il.policies.parts.network import ChunkNetwork, masked_mean

Loss = Literal["l1", "l2", "huber"]
DISTANCES: dict[str, Callable[..., Tensor]] = {
    "l1": functional.l1_loss,
    "l2": functional.mse_loss,
    "huber": functional.smooth_l1_loss,
}
LOG_2PI = math.log(2 * math.pi)


def hidden_layers(inputs: int, widths: tuple[int, ...], dropout: float = 0.0) -> list[nn.Sequential]:
    """Return one block of Linear, LayerNorm, GELU and dropout for each of ``widths``."""
    return [_layer(a, b, dropout) for a, b in pairwise((inputs, *widths))]


def _layer(inputs: int, outputs: int, dropout: float) -> nn.Sequential:
    parts: list[nn.Module] = [nn.Linear(inputs, outputs), nn.LayerNorm(outputs), nn.GELU()]
    return nn.Sequential(*parts, *([nn.Dropout(dropout)] if dropout else []))


class Head(nn.Module, ABC):
    """Maps features (B, F) to chunks (B, Ta, Da).

    Args:
        features: F. shape: (Ta, Da).

    Attributes:
        noise_size: numbers that choosing one chunk takes, 0 where nothing is drawn.
    """

    noise_size: int = 0

    def __init__(self, features: int, shape: tuple[int, int], outputs: int) -> None:
        super().__init__()
        self.shape = shape
        self.linear = nn.Linear(features, outputs)

    @abstractmethod
    def forward(self, features: Tensor, noise: Tensor | None = None) -> Tensor:
        """Return the chunks to fly."""

    @abstractmethod
    def loss(self, features: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        """Return the scalar to minimise and named scalars to log; arguments as in ``ChunkNetwork.loss``."""


class PointHead(Head):
    """One chunk, judged by its distance to the demonstrated one."""

    def __init__(self, features: int, shape: tuple[int, int], loss: Loss = "l1") -> None:
        super().__init__(features, shape, math.prod(shape))
        self.distance = DISTANCES[loss]

    def forward(self, features: Tensor, noise: Tensor | None = None) -> Tensor:
        return self.linear(features).unflatten(-1, self.shape)

    def loss(self, features: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        return masked_mean(self.distance(self(features), actions, reduction="none"), valid), {}


class GaussianHead(Head):
    """A normal distribution for each element; its mean is flown."""

    def __init__(self, features: int, shape: tuple[int, int], min_std: float) -> None:
        super().__init__(features, shape, 2 * math.prod(shape))
        self.min_std = min_std

    def forward(self, features: Tensor, noise: Tensor | None = None) -> Tensor:
        return self._distribution(features)[0]

    def loss(self, features: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        mean, std = self._distribution(features)
        return masked_mean(-log_normal(actions, mean, std), valid), {"std": masked_mean(std, valid).detach()}

    def _distribution(self, features: Tensor) -> tuple[Tensor, Tensor]:
        mean, raw = self.linear(features).unflatten(-1, (2, *self.shape)).unbind(1)
        return mean, functional.softplus(raw) + self.min_std


class MixtureHead(Head):
    """Several normal distributions over the whole chunk, so that a mode is a way of going on and not of one step.

    One of the modes is drawn by its weight and its mean flown ("low-noise evaluation"); without noise, the likeliest.
    """

    noise_size = 1

    def __init__(self, features: int, shape: tuple[int, int], modes: int, min_std: float) -> None:
        super().__init__(features, shape, modes * (1 + 2 * math.prod(shape)))
        self.modes, self.min_std = modes, min_std

    def forward(self, features: Tensor, noise: Tensor | None = None) -> Tensor:
        logits, means, _ = self._distribution(features)
        if noise is None:
            chosen = logits.argmax(-1)
        else:
            below = torch.cumsum(torch.softmax(logits, -1), -1) < torch.special.ndtr(noise)  # uniform in (0, 1)
            chosen = below.sum(-1).clamp(max=self.modes - 1)
        return means[torch.arange(means.shape[0], device=means.device), chosen]

    def loss(self, features: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        logits, means, stds = self._distribution(features)
        elements = log_normal(actions[:, None], means, stds).sum(-1)  # (B, K, Ta)
        chunks = (elements * valid[:, None]).sum(-1)
        likelihood = torch.logsumexp(torch.log_softmax(logits, -1) + chunks, -1)
        per_element = -likelihood.sum() / torch.clamp(valid.sum() * self.shape[1], min=1.0)
        used = torch.softmax(logits, -1).mean(0)
        return per_element, {"modes_used": (-(used * torch.log(used + 1e-9)).sum()).exp().detach()}

    def _distribution(self, features: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        raw = self.linear(features)
        logits, normal = raw[:, : self.modes], raw[:, self.modes :].unflatten(-1, (2, self.modes, *self.shape))
        return logits, normal[:, 0], functional.softplus(normal[:, 1]) + self.min_std


class HeadedNetwork(ChunkNetwork):
    """A body that makes features (B, F) of observations, and a head.

    Args:
        redraws: see :class:`ChunkNetwork`.
    """

    def __init__(self, body: nn.Module, head: Head, *, redraws: bool = False) -> None:
        super().__init__()
        self.body, self.head = body, head
        self.noise_size, self.redraws = head.noise_size, redraws

    def forward(self, obs: Tensor, noise: Tensor | None = None) -> Tensor:
        return self.head(self.body(obs), noise)

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        return self.head.loss(self.body(obs), actions, valid)


def log_normal(x: Tensor, mean: Tensor, std: Tensor) -> Tensor:
    """Return the log density of each element of ``x`` under a normal distribution."""
    return -0.5 * ((x - mean) / std) ** 2 - torch.log(std) - 0.5 * LOG_2PI
