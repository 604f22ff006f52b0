"""All cameras of a robot with what they tell: from observations of n worlds to estimates of what is out there."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.core.contracts import Observation
from aerial_il.core.specs import EnvSpec, ObservationSpec
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts.relative import rotations
from aerial_il.policies.perception.cameras import MOUNTS, Camera, Pose
from aerial_il.policies.perception.network import Eye, told_of
from aerial_il.policies.perception.relations import sources_of
from aerial_il.policies.perception.targets import NUMBER, PLACE, Target, Targets
from aerial_il.policies.perception.tracker import Measurement, Tracker

FORCE_N = 10.0  # by which forces are divided, and beyond which they are not told apart
PRESENT, ABSENT = 1.0, -1.0  # logits above and below which a place is taken to be in the image, and not to be


class Carried(NamedTuple):
    """How the tools of n worlds have moved: turned by ``turn`` (n, 3, 3), from ``before`` to ``after`` (n, 3) m."""

    turn: np.ndarray
    before: np.ndarray
    after: np.ndarray

    @staticmethod
    def between(then: Observation, now: Observation) -> Carried:
        """Return how they moved between two observations."""
        turn = rotations(now["ee_rot6d"]) @ np.swapaxes(rotations(then["ee_rot6d"]), 1, 2)
        return Carried(turn, then["ee_pos"], now["ee_pos"])

    def now(self, places: np.ndarray) -> np.ndarray:
        """Return where places (n, 3) are that went along."""
        return self.after + np.einsum("nij,nj->ni", self.turn, places - self.before)


class Eyes(nn.Module):
    """A network behind each camera.

    Args:
        targets: what is estimated. cameras: calibrated. sizes: (H, W) of each one's images.
        own: fields of its own that the robot knows beside the images. knows: numbers of these. width: of hidden layers.
    """

    def __init__(
        self,
        targets: Targets,
        cameras: Sequence[Camera],
        sizes: Sequence[tuple[int, int]],
        own: Sequence[str],
        knows: int,
        width: int,
    ) -> None:
        super().__init__()
        self.targets, self.cameras, self.own, self.width = targets, tuple(cameras), tuple(own), width
        self.sizes, self.knows = tuple(sizes), knows
        self.eyes = nn.ModuleList(Eye(targets.estimated, size, knows, width) for size in sizes)

    @staticmethod
    def of(spec: EnvSpec, images: Sequence[str], targets: Targets, width: int) -> Eyes:
        """Return new eyes for the images of ``spec``."""
        own, cameras = own_fields(spec.observation), [Camera.of(spec, image) for image in images]
        shapes = [spec.observation[image].shape for image in images]
        sizes = [(height, width) for height, width, _ in shapes]
        return Eyes(targets, cameras, sizes, own, 4 + spec.observation.size(own), width)

    @property
    def poses(self) -> tuple[str, ...]:
        """Fields by which it is known where its cameras are, and the tool."""
        mounts = ("tool", *(camera.mount for camera in self.cameras))
        return tuple(dict.fromkeys(name for mount in mounts for name in MOUNTS[mount]))

    def known(self, obs: Observation, pose: Pose) -> np.ndarray:
        """Return (n, K) float32 what a camera's network is told: how it is held, how high, and the robot's own."""
        down, height = -pose.rot[:, 2], pose.pos[:, 2:]
        own = [np.clip(obs[name] / FORCE_N, -1.0, 1.0) if name.endswith("_force") else obs[name] for name in self.own]
        return np.concatenate([down, height, *own], axis=1).astype(np.float32)

    @torch.inference_mode()
    def tell(
        self, tracker: Tracker, k: int, obs: Observation, then: Observation, age: np.ndarray, mask: np.ndarray
    ) -> None:
        """Look through camera ``k`` in the worlds of ``mask`` (n,) bool, and tell the tracker.

        Args:
            obs: what is shown now. then: what the robot knew of itself when the image was taken.
            age: (n,) control steps since then.
        """
        camera, carried, targets = self.cameras[k], Carried.between(then, obs), self.targets.estimated
        pose = camera.pose(then)
        told = self.eyes[k](tensor(obs[camera.image][mask]), tensor(self.known(then, pose)[mask]))
        whole = torch.zeros(len(mask), told.shape[1], dtype=torch.float64)
        whole[torch.from_numpy(mask)] = told.double()
        for target, (mean, spread, logits) in zip(targets, told_of(targets, whole), strict=True):
            means, sigma = mean.numpy(), np.exp(spread.numpy())
            if target.kind == PLACE:
                assert logits is not None
                seen, cov = mask & (logits.numpy() > PRESENT), camera.spread(means, sigma)
                expected = camera.in_view(pose.seen(tracker.estimate(target.field)))
                tracker.doubt(target.field, mask & expected & (logits.numpy() < ABSENT))
                turn = pose.rot
                values = pose.placed(camera.unproject(means))
                cov = turn @ cov @ np.swapaxes(turn, 1, 2)
                tracker.tell(target.field, seen, Measurement(values, cov, age, carried.now(values)))
            else:
                unit = target.scale if target.kind == NUMBER else 1.0
                variance = np.broadcast_to(np.square(sigma * unit), means.shape)
                tracker.tell(target.field, mask, Measurement(target.decode(means, pose), variance, age))

    def complete(self, obs: Observation, estimates: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return ``field -> (n, D)`` of all that a robot looks for: estimated, constant, and what follows from them."""
        n = len(next(iter(obs.values())))
        found = {**{name: np.tile(value, (n, 1)) for name, value in self.targets.constant.items()}, **estimates}
        sources, sums = {**sources_of(obs, ()), **found}, defaultdict[str, list[np.ndarray]](list)
        for each in self.targets.sums:
            sources[each.field] = each.of(sources)
            sums[each.field].append(sources[each.field])
        return found | {name: np.concatenate(points, axis=1) for name, points in sums.items()}

    def to_dict(self) -> dict[str, Any]:
        """Return plain values that rebuild it, but its weights."""
        return {
            "targets": self.targets.to_dict(),
            "cameras": [camera.to_dict() for camera in self.cameras],
            "sizes": [list(size) for size in self.sizes],
            "own": list(self.own),
            "knows": self.knows,
            "width": self.width,
        }

    @staticmethod
    def from_dict(raw: Mapping[str, Any]) -> Eyes:
        """Undo :meth:`to_dict`."""
        cameras = [Camera.from_dict(each) for each in raw["cameras"]]
        sizes = [(int(height), int(width)) for height, width in raw["sizes"]]
        return Eyes(Targets.from_dict(raw["targets"]), cameras, sizes, raw["own"], int(raw["knows"]), int(raw["width"]))


def own_fields(spec: ObservationSpec) -> tuple[str, ...]:
    """Return what the networks are told of the robot: joints, gripper, and what it feels; not where it is."""
    felt = [f.name for f in spec.of_group("task") if f.onboard and f.unit == "N"]
    return tuple(name for name in ("joint_pos", "gripper", *felt) if name in spec.names)


def labels_of(targets: Sequence[Target], camera: Camera, obs: Observation) -> tuple[list[Tensor], list[Tensor | None]]:
    """Return what a camera is to tell of each target (n, D) in n steps, and of each place whether it is in view."""
    pose = camera.pose(obs)
    labels, visible = list[Tensor](), list[Tensor | None]()
    for target in targets:
        values = target.values(obs)
        labels.append(tensor(target.encode(values, pose, camera).astype(np.float32)))
        seen = camera.in_view(pose.seen(values)) if target.kind == PLACE else None
        visible.append(None if seen is None else tensor(seen.astype(np.float32)))
    return labels, visible
