"""A discriminator, which tells a demonstrator's actions from an agent's, and what regularises it.

With D the probability that a transition is the demonstrator's, ``logit = log D - log (1 - D)``. The agent's reward is

========= ============================ ==================================================================
``gail``  ``-log(1 - D)``  >= 0         rewards staying; from many demonstrations
``airl``  ``log D - log(1 - D)``       of either sign; from few demonstrations
``exit``  ``log D``        <= 0         rewards ending soon
========= ============================ ==================================================================

Source: J. Ho, S. Ermon, "Generative Adversarial Imitation Learning", 2016; J. Fu et al., "Learning Robust Rewards with
Adversarial Inverse Reinforcement Learning", 2018; M. Orsini et al., "What Matters for Adversarial Imitation
Learning?", 2021.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.parametrizations import spectral_norm

from aerial_il.policies.parts.normaliser import HARDLY

Reward = Literal["gail", "airl", "exit"]
REWARDS: dict[str, Callable[[Tensor], Tensor]] = {
    "gail": functional.softplus,
    "airl": lambda logit: logit,
    "exit": functional.logsigmoid,
}


LIMIT = 10.0  # of standardised inputs: what was hardly seen, such as a rare end, must not overwhelm


class RunningNorm(nn.Module):
    """Standardise inputs (B, D) by the moments of all batches that :meth:`add` was given, saved with the weights."""

    def __init__(self, size: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("square", torch.zeros(size))
        self.register_buffer("count", torch.zeros(()))

    count: Tensor
    mean: Tensor
    square: Tensor

    @torch.no_grad()
    def add(self, inputs: Tensor) -> None:
        """Take a batch in; see :class:`aerial_il.algorithms.online.moments.RunningMoments`."""
        count, away = len(inputs), inputs.mean(0) - self.mean
        total = self.count + count
        self.square += ((inputs - inputs.mean(0)) ** 2).sum(0) + away**2 * self.count * count / total
        self.mean += away * count / total
        self.count += count

    def forward(self, inputs: Tensor) -> Tensor:
        deviation, size = (self.square / self.count.clamp(min=1.0)).sqrt(), self.mean.abs()
        scale = torch.where(deviation <= HARDLY * (size + deviation), size.clamp(min=1.0), deviation)
        return ((inputs - self.mean) / scale).clamp(-LIMIT, LIMIT)


class Discriminator(nn.Module):
    """A perceptron from the concatenated inputs (B, ·) to one number each (B,).

    Args:
        inputs: elements of an input.
        hidden: widths of the hidden layers, with tanh between them: a kinked network has a useless gradient penalty.
        spectral: divide each weight matrix by its largest singular value, so that no input moves the score fast.
        dropout: probability of dropping an input or a hidden unit while training.
        running_norm: standardise the inputs by their running moments.
    """

    def __init__(
        self, inputs: int, hidden: Sequence[int], *, spectral: bool, dropout: float, running_norm: bool
    ) -> None:
        super().__init__()
        self.norm = RunningNorm(inputs) if running_norm else None
        parts: list[nn.Module] = []
        for a, b in pairwise((inputs, *hidden)):
            parts += [*([nn.Dropout(dropout)] if dropout else []), _linear(a, b, spectral), nn.Tanh()]
        self.layers = nn.Sequential(*parts, _linear(hidden[-1], 1, spectral))

    def forward(self, *inputs: Tensor) -> Tensor:
        return self.score(self.standardised(torch.cat(inputs, dim=-1)))

    def standardised(self, inputs: Tensor) -> Tensor:
        """Return joined inputs (B, D) as the layers see them."""
        return self.norm(inputs) if self.norm is not None else inputs

    def score(self, standardised: Tensor) -> Tensor:
        """Return one number (B,) for each row of :meth:`standardised`."""
        return self.layers(standardised)[..., 0]


def cross_entropy(expert: Tensor, agent: Tensor) -> tuple[Tensor, dict[str, float]]:
    """Return ``-log D`` of the demonstrator's logits (B,) ``- log(1 - D)`` of the agent's, and both accuracies."""
    loss = functional.softplus(-expert).mean() + functional.softplus(agent).mean()
    shares = {"expert": (expert > 0).float().mean().item(), "agent": (agent < 0).float().mean().item()}
    return loss, {"reward/loss": loss.item(), **{f"reward/acc_{who}": share for who, share in shares.items()}}


def gradient_penalty(score: Callable[[Tensor], Tensor], expert: Tensor, agent: Tensor, mix: Tensor) -> Tensor:
    """Return the mean of ``(|d score / d x| - 1)^2`` at points x between the demonstrator's and the agent's.

    Args:
        score: maps (B, D) to (B,), row by row.
        expert, agent: (B, D).
        mix: (B, 1) in [0, 1], where between them.

    Source: I. Gulrajani et al., "Improved Training of Wasserstein GANs", 2017, equation 3.
    """
    between = (mix * expert + (1 - mix) * agent).detach().requires_grad_(True)
    (slope,) = torch.autograd.grad(score(between).sum(), between, create_graph=True)
    return ((slope.norm(dim=1) - 1.0) ** 2).mean()


def _linear(inputs: int, outputs: int, spectral: bool) -> nn.Module:
    layer = nn.Linear(inputs, outputs)
    return spectral_norm(layer) if spectral else layer
