"""The auxiliary loss of policies with eyes: what is hidden from them, told of each image while they are trained.

From a few thousand frames an encoder learns slowly what matters in them if all that it is taught by is the action that
followed. So the features of each camera have a linear head that tells what the demonstrations know and the policy is
not shown, in the terms of :mod:`aerial_il.policies.perception.targets`. The heads do not fly.

Source: S. James et al., "Transferring End-to-End Visuomotor Control from Simulation to Real World for a Multi-Stage
Task", 2017 (where objects are as auxiliary outputs of a policy that sees).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import smooth_l1_loss

from aerial_il.algorithms.seeing.measurable import check_cameras, check_labels, check_one_task
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.parts.network import ChunkNetwork, Seen
from aerial_il.policies.parts.vision import Looked, VisionNetwork
from aerial_il.policies.perception.cameras import Camera
from aerial_il.policies.perception.eyes import labels_of
from aerial_il.policies.perception.targets import PLACE, Target, Targets

BETA = 0.1  # below which the loss is a square: of a place about three pixels of 64
HINT = "Hide where objects are (observations=onboard policy.images=[wrist_rgb,base_rgb]), or leave auxiliary=0."


@dataclass(frozen=True, eq=False)
class Hidden:
    """What is hidden from a policy and told of its images.

    Attributes:
        targets: in the order of the labels. cameras: whose colour images it is told of.
        weight: of the auxiliary loss beside the policy's own.
    """

    targets: tuple[Target, ...]
    cameras: tuple[Camera, ...]
    weight: float

    @staticmethod
    def of(layout: Layout, demos: Sequence[Episode], weight: float) -> Hidden:
        """Return what ``layout`` hides of what the demonstrations know.

        Raises:
            InvalidValueError: that is nothing, nothing is looked at, where a camera is or was is not known, they are of
                several tasks, or know it with errors alone.
        """
        spec = layout.spec
        hidden = [name for name in spec.observation.to_be_seen if name not in layout.names]
        images = [name for name in layout.images if spec.observation[name].is_colour]
        if not images or not hidden:
            lacking = "nothing is hidden from it" if images else "it sees no colour image"
            raise InvalidValueError(f"The auxiliary loss tells what is hidden from a policy, and {lacking}. {HINT}")
        check_one_task(demos, "The auxiliary loss")
        check_cameras(demos, images)
        for shown in {demo.spec.tier: demo.spec for demo in demos}.values():
            check_labels(shown, "Record them without: aerial-il collect tier={tier}, or leave auxiliary=0.")
        estimated = Targets.of(spec.observation, [demo.obs for demo in demos], hidden).estimated
        told = tuple(target for target in estimated if {*target.parts} <= {*hidden})
        if not told:
            raise InvalidValueError(
                f"Hidden are {hidden}; none varies by itself, so that there is nothing to tell. {HINT}"
            )
        return Hidden(told, tuple(Camera.of(spec, name) for name in images), weight)

    @property
    def size(self) -> int:
        """Numbers S that are told of an image."""
        return sum(target.size for target in self.targets)

    @property
    def moves(self) -> Tensor:
        """(2, S), the numbers that move with the image: across of each place, and up."""
        parts = [torch.eye(2, each.size) if each.kind == PLACE else torch.zeros(2, each.size) for each in self.targets]
        return torch.cat(parts, dim=1)

    def labels(self, demos: Sequence[Episode]) -> dict[str, list[np.ndarray]]:
        """Return camera field -> of each demonstration (T + 1, S) float32, NaN where a place is out of its view."""
        return {camera.image: [self._told(demo, camera) for demo in demos] for camera in self.cameras}

    def _told(self, demo: Episode, camera: Camera) -> np.ndarray:
        taken = demo.spec.observation[camera.image].taken_at(np.arange(len(demo) + 1))
        obs = {name: demo.obs[name][taken] for name in demo.spec.observation.state_names}
        labels, visible = labels_of(self.targets, camera, obs)
        told = [
            label if seen is None else label.masked_fill(seen[:, None] == 0.0, torch.nan)
            for label, seen in zip(labels, visible, strict=True)
        ]
        return torch.cat(told, dim=1).numpy()


class Telling(ChunkNetwork):
    """A network with eyes while it is trained: beside acting, it tells what is hidden from it.

    Args:
        network: what will fly. hidden: what it tells.
    """

    moves: Tensor

    def __init__(self, network: VisionNetwork, hidden: Hidden) -> None:
        super().__init__()
        self.network, self.weight = network, hidden.weight
        self.heads = nn.ModuleDict(
            {camera.image: nn.Linear(network.image_features, hidden.size) for camera in hidden.cameras}
        )
        self.register_buffer("moves", hidden.moves, persistent=False)

    @property
    def flown(self) -> ChunkNetwork:
        return self.network

    def forward(self, obs: Seen, noise: Tensor | None = None) -> Tensor:
        return self.network(obs, noise)

    def loss(self, obs: Seen, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        looked = self.network.look(obs)
        loss, logged = self.network.body.loss(self.network.joined(obs.state, looked), actions, valid)
        each = [self._missed(head, looked[name], obs.labels[name]) for name, head in self.heads.items()]
        auxiliary = torch.stack(each).mean()
        return loss + self.weight * auxiliary, {**logged, "auxiliary": auxiliary.detach()}

    def _missed(self, head: nn.Module, looked: Looked, labels: Tensor) -> Tensor:
        """Return the mean loss of what is told of images, of places as they lie in the parts that were looked at."""
        if looked.shift is not None:
            labels = labels - (looked.shift @ self.moves)[:, None]
        known = labels.isfinite()
        missed = smooth_l1_loss(head(looked.features).float(), labels.nan_to_num(), reduction="none", beta=BETA)
        return (missed * known).sum() / known.sum().clamp(min=1)
