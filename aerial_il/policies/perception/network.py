"""The network behind one camera: what it tells of each target, and how sure it is.

Of each number it tells a mean and a standard deviation, and of each place whether it is in the image. It is shown,
beside the image, how the camera is held and what the robot feels, but not where the robot is: what it learned in one
place then holds in another.

Source: M. Seitzer et al., "On the Pitfalls of Heteroscedastic Uncertainty Estimation with Probabilistic Neural
Networks", 2022, equation 5 (a likelihood weighted by the variance to the power of beta, 0.5).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from aerial_il.policies.parts.vision import SpatialSoftmax
from aerial_il.policies.perception.targets import NUMBER, PLACE, Target

CHANNELS, KERNELS, STRIDES = (16, 32, 64, 64), (5, 3, 3, 3), (2, 2, 1, 1)
MAP, GROUPS, BETA = 8, 8, 0.5
PRESENCE = 0.5  # weight of whether a place is in the image
SHARPEST, BLUREST = -6.0, 3.0  # log standard deviations


class Eye(nn.Module):
    """Maps images (B, H, W, 3) uint8 and what the robot knows beside them (B, K) to what is told (B, S).

    Args:
        targets: what it tells of. size: (H, W). knows: K. width: of its hidden layers.
    """

    def __init__(self, targets: Sequence[Target], size: tuple[int, int], knows: int, width: int) -> None:
        super().__init__()
        self.sizes = [told_size(target) for target in targets]
        layers: list[nn.Module] = []
        for inputs, outputs, kernel, stride in zip((3, *CHANNELS), CHANNELS, KERNELS, STRIDES, strict=False):
            layers += [
                nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2),
                nn.GroupNorm(GROUPS, outputs),
                nn.GELU(),
            ]
        self.trunk, self.where, self.what = (
            nn.Sequential(*layers),
            SpatialSoftmax(CHANNELS[-1]),
            nn.Conv2d(CHANNELS[-1], MAP, 1),
        )
        cells = MAP * -(-size[0] // 4) * -(-size[1] // 4)
        self.mix = nn.Sequential(
            nn.Linear(3 * CHANNELS[-1] + cells + knows, width), nn.LayerNorm(width), nn.GELU(),
            nn.Linear(width, width), nn.GELU(), nn.Linear(width, sum(self.sizes)),
        )  # fmt: skip

    def forward(self, images: Tensor, knows: Tensor) -> Tensor:
        planes = images.permute(0, 3, 1, 2).float().div_(127.5).sub_(1).contiguous()
        maps = self.trunk(planes)
        seen = torch.cat([self.where(maps), functional.gelu(self.what(maps)).flatten(1), knows], dim=1)
        return self.mix(seen)


def told_size(target: Target) -> int:
    """Return how many numbers a network tells of a target: means, log deviations, of a place whether it is there."""
    deviations = target.size if target.kind in (PLACE, NUMBER) else 1
    return target.size + deviations + (target.kind == PLACE)


class Told(NamedTuple):
    """What is told of a target: means (B, D), log deviations (B, D or 1) and, of a place, logits (B,)."""

    mean: Tensor
    spread: Tensor
    logits: Tensor | None


def told_of(targets: Sequence[Target], told: Tensor) -> list[Told]:
    """Return what is told of each target, of all that a network tells (B, S)."""
    sizes = [told_size(target) for target in targets]
    return [_split(target, part) for target, part in zip(targets, told.split(sizes, 1), strict=True)]


def _split(target: Target, part: Tensor) -> Told:
    spread = part[:, target.size : told_size(target) - (target.kind == PLACE)]
    logits = part[:, -1] if target.kind == PLACE else None
    return Told(part[:, : target.size], spread.clamp(SHARPEST, BLUREST), logits)


def loss_of(
    targets: Sequence[Target], told: Tensor, labels: Sequence[Tensor], visible: Sequence[Tensor | None]
) -> Tensor:
    """Return the scalar to minimise.

    Args:
        targets: T of them. told: (B, S). labels: of each, (B, D), as cameras are to tell it.
        visible: of each place (B,) 1 where it is in the image; None of others.
    """
    losses = []
    for (mean, spread, logits), label, seen in zip(told_of(targets, told), labels, visible, strict=True):
        each = (0.5 * (label - mean).square() * torch.exp(-2 * spread) + spread) * torch.exp(2 * BETA * spread).detach()
        if logits is None:
            losses.append(each.mean())
        else:
            assert seen is not None
            losses.append((each.mean(1) * seen).sum() / seen.sum().clamp(min=1.0))
            losses.append(PRESENCE * functional.binary_cross_entropy_with_logits(logits, seen))
    return torch.stack(losses).sum()
