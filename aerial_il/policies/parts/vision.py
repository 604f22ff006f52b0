"""Image observations for every policy: encoders whose features join the observation vector.

A network that was written for vectors needs no change to see: :class:`VisionNetwork` turns each image into a few
features and hands a longer vector on. Images stay uint8 until the encoder, which sees them in [-1, 1]. While it trains
it looks at a random part of each image, one for all images of a window and camera, which is what keeps a few
thousand frames from being learned by heart; in flight it looks at the middle.

Sources: spatial softmax: S. Levine et al., "End-to-End Training of Deep Visuomotor Policies", 2016, section 4.1;
GroupNorm instead of batch statistics, which averaged weights would not fit: C. Chi et al., "Diffusion Policy", 2023,
section III-B; random crops: D. Yarats et al., "Image Augmentation Is All You Need", 2021.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.parts.network import ChunkNetwork, PolicySettings, Seen

CHANNELS, GROUPS = (16, 32, 32), 8
FAR_M = 2.0  # what is farther is as far: depth is clipped to it, and seen in [-1, 1] as colours are
SMALLEST = 16  # pixels that the CNN can still halve twice


def build_network(config: PolicySettings, layout: Layout) -> ChunkNetwork:
    """Return a new network of ``config`` for what ``layout`` shows, with eyes where that includes images."""
    if layout.images:
        return VisionNetwork(config, layout)
    return config.build(layout.size, layout.spec.action.size)


class Looked(NamedTuple):
    """What an encoder makes of the images of a camera.

    Attributes:
        features: (B, To, F).
        shift: (B, 2), by how much of half an image the part that it looked at lies right of its middle, and above;
            None of the middle part.
    """

    features: Tensor
    shift: Tensor | None


class VisionNetwork(ChunkNetwork):
    """Any network behind one encoder per camera.

    Args:
        config: builds the network, and says how images are encoded.
        layout: which images it sees.

    Attributes:
        eyes: an encoder for each image. body: what acts upon state and features.
    """

    def __init__(self, config: PolicySettings, layout: Layout) -> None:
        super().__init__()
        self.cameras, self.crop, self.image_features = layout.images, config.crop, config.image_features
        for name, shape in zip(layout.images, layout.image_shapes, strict=True):
            _check_size(name, _cropped(shape, config.crop))
        self.eyes = nn.ModuleList(_encoder(config) for _ in self.cameras)
        self.body = config.build(layout.size + len(self.cameras) * config.image_features, layout.spec.action.size)
        self.noise_size, self.redraws, self.guided = self.body.noise_size, self.body.redraws, self.body.guided

    def forward(self, obs: Seen, *noise: Tensor, **guide: Any) -> Tensor:
        return self.body(self.see(obs), *noise, **guide)

    def loss(self, obs: Seen, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        return self.body.loss(self.see(obs), actions, valid)

    def see(self, obs: Seen) -> Tensor:
        """Return state and features (B, To, D)."""
        return self.joined(obs.state, self.look(obs))

    def look(self, obs: Seen) -> dict[str, Looked]:
        """Return what the encoders make of the images, by camera field."""
        return {name: self._look(eye, obs.images[name]) for eye, name in zip(self.eyes, self.cameras, strict=True)}

    def joined(self, state: Tensor, looked: Mapping[str, Looked]) -> Tensor:
        """Return a state (B, To, Do) with features beside it (B, To, D)."""
        return torch.cat([state, *(looked[name].features for name in self.cameras)], dim=-1)

    def _look(self, eye: nn.Module, images: Tensor) -> Looked:
        """Return what ``eye`` makes of images (B, To, H, W, 3) uint8, or (B, To, H, W) m."""
        size, is_depth = _cropped(images.shape[2:4], self.crop), images.is_floating_point()
        images = images[..., None] if is_depth else images
        corner = random_corner(images, *size) if self.training else None
        seen = (middle_part(images, *size) if corner is None else part_at(images, corner, *size)).flatten(0, 1)
        planes = seen.permute(0, 3, 1, 2).contiguous()  # as a view, two and a half times as long on a processor
        scaled = (
            (planes.clamp(0.0, FAR_M) * (2.0 / FAR_M)).repeat(1, 3, 1, 1) if is_depth else planes.float().div_(127.5)
        )
        features = eye(scaled.sub_(1)).unflatten(0, images.shape[:2])
        return Looked(features, None if corner is None else _shift(images, corner, size))


def middle_part(images: Tensor, height: int, width: int) -> Tensor:
    """Return the middle of images (B, To, H, W, C) as (B, To, height, width, C)."""
    top, left = (images.shape[2] - height) // 2, (images.shape[3] - width) // 2
    return images[:, :, top : top + height, left : left + width]


def random_corner(images: Tensor, height: int, width: int) -> Tensor:
    """Return where a random part of images (B, To, H, W, C) begins, one for each window: rows and columns (B, 2)."""
    count, device = len(images), images.device
    top = torch.randint(images.shape[2] - height + 1, (count, 1), device=device)
    return torch.cat([top, torch.randint(images.shape[3] - width + 1, (count, 1), device=device)], dim=1)


def part_at(images: Tensor, corner: Tensor, height: int, width: int) -> Tensor:
    """Return the part of images (B, To, H, W, C) that begins at ``corner`` (B, 2): (B, To, height, width, C)."""
    rows, columns = (
        corner[:, k : k + 1] + torch.arange(n, device=images.device) for k, n in enumerate((height, width))
    )
    window = torch.arange(len(images), device=images.device)[:, None, None]
    picked = images.transpose(0, 1)[:, window, rows[:, :, None], columns[:, None, :]]
    return picked.transpose(0, 1)


def _shift(images: Tensor, corner: Tensor, size: tuple[int, int]) -> Tensor:
    """Return the shift (B, 2) of :class:`Looked` of a part of images (B, To, H, W, C) of this size."""
    whole, part = (torch.tensor(sides, device=images.device) for sides in (images.shape[2:4], size))
    down, right = ((2 * corner + part - whole) / whole).unbind(1)
    return torch.stack([right, -down], dim=1)


class SpatialSoftmax(nn.Module):
    """Where each channel of a map is brightest, and how bright it is on the whole: (N, C, H, W) to (N, 3 C)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.sharpness = nn.Parameter(torch.ones(channels))

    def forward(self, maps: Tensor) -> Tensor:
        weights = torch.softmax(maps.flatten(2) * self.sharpness[:, None], dim=-1).unflatten(2, maps.shape[2:])
        down, across = (torch.linspace(-1, 1, side, device=maps.device, dtype=maps.dtype) for side in maps.shape[2:])
        return torch.cat([weights.sum(3) @ down, weights.sum(2) @ across, maps.mean((2, 3))], dim=-1)


def _encoder(config: PolicySettings) -> nn.Sequential:
    trunk, channels = _resnet18() if config.encoder == "resnet18" else _cnn()
    width = config.image_features
    return nn.Sequential(*trunk, SpatialSoftmax(channels), nn.Linear(3 * channels, width), nn.LayerNorm(width))


def _cnn() -> tuple[list[nn.Module], int]:
    """Three convolutions; the map has a quarter of the image's side, fine enough to tell where something is."""
    layers: list[nn.Module] = []
    for inputs, outputs, kernel, stride in zip((3, *CHANNELS), CHANNELS, (5, 3, 3), (2, 2, 1), strict=False):
        layers += [nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2), nn.GroupNorm(GROUPS, outputs), nn.GELU()]
    return layers, CHANNELS[-1]


def _resnet18() -> tuple[list[nn.Module], int]:
    """ResNet-18 of torchvision's blocks from random weights, with GroupNorm, without pooling and classifier."""
    from torchvision.models.resnet import BasicBlock, conv1x1

    def norm(channels: int) -> nn.Module:
        return nn.GroupNorm(channels // 16, channels)

    layers: list[nn.Module] = [nn.Conv2d(3, 64, 7, 2, 3, bias=False), norm(64), nn.ReLU(), nn.MaxPool2d(3, 2, 1)]
    for inputs, outputs in pairwise((64, 64, 128, 256, 512)):
        halves = inputs < outputs
        shortcut = nn.Sequential(conv1x1(inputs, outputs, 2), norm(outputs)) if halves else None
        first = BasicBlock(inputs, outputs, 2 if halves else 1, shortcut, norm_layer=norm)
        layers.append(nn.Sequential(first, BasicBlock(outputs, outputs, norm_layer=norm)))
    for part in (part for layer in layers for part in layer.modules() if isinstance(part, nn.Conv2d)):
        nn.init.kaiming_normal_(part.weight, mode="fan_out", nonlinearity="relu")
    return layers, 512


def _cropped(shape: tuple[int, ...], crop: float) -> tuple[int, int]:
    height, width = map(int, shape[:2])  # of a graph that is traced they are tensors
    return max(1, round(crop * height)), max(1, round(crop * width))


def _check_size(name: str, size: tuple[int, int]) -> None:
    if min(size) < SMALLEST:
        raise InvalidValueError(
            f"Image {name!r} is {size[0]} x {size[1]} after crop; it needs {SMALLEST} x {SMALLEST}."
        )
