"""Frames: images of single steps, with what was known and what was to be seen in them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from torch import Tensor

from aerial_il.core.computer import free_memory_bytes
from aerial_il.core.contracts import BatchEnv, Observation, Repainted
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec
from aerial_il.core.tensors import tensor
from aerial_il.data.episode import Episode
from aerial_il.policies.perception.eyes import Eyes, labels_of

MOST_LOOKS, GIB = 2**31, 2**30
Moments = Sequence[tuple[int, int]]  # flight, step


@dataclass(frozen=True, eq=False)
class Frames:
    """Single steps of flights.

    Attributes:
        obs: field -> (N, ...): images, the robot's own pose and fields, and the truth of what is estimated.
    """

    obs: Mapping[str, np.ndarray]

    def __len__(self) -> int:
        return len(next(iter(self.obs.values())))

    @staticmethod
    def joined(parts: Iterable[Observation]) -> Frames:
        """Return all steps of ``parts``, which have the same fields."""
        listed = list(parts)
        return Frames({name: np.concatenate([part[name] for part in listed]) for name in listed[0]})


def check_room(spec: EnvSpec, images: Sequence[str], count: int) -> None:
    """Refuse more frames, or larger ones, than memory holds; when they are joined each is there twice.

    Raises:
        InvalidValueError: says how much they take, and how it would be less.
    """
    wanted = 2 * count * sum(math.prod(spec.observation[image].shape) for image in images)
    if wanted > (room := free_memory_bytes()):
        raise InvalidValueError(
            f"{count} frames of {', '.join(images)} take {wanted / GIB:.1f} GiB of memory, of which {room / GIB:.1f} "
            "GiB are free. Look at smaller ones (aerial-il collect image_size=[64,64]), or at fewer (algorithm.frames, "
            "algorithm.redrawn, algorithm.flown)."
        )


def kept_fields(eyes: Eyes) -> tuple[str, ...]:
    """Return the fields that frames for some eyes hold."""
    targets = [part for target in eyes.targets.estimated for part in target.parts]
    return tuple(dict.fromkeys([*(camera.image for camera in eyes.cameras), *eyes.poses, *eyes.own, *targets]))


def chosen(flights: Sequence[Episode], count: int, rng: np.random.Generator) -> list[tuple[int, int]]:
    """Return ``count`` moments (flight, step), at random among all; all of them where there are no more."""
    whole = [(k, step) for k, flight in enumerate(flights) for step in range(len(flight) + 1)]
    if count >= len(whole):
        return whole
    return [whole[int(i)] for i in np.sort(rng.choice(len(whole), count, replace=False))]


def drawn(
    env: BatchEnv, flights: Sequence[Episode], moments: Moments, names: Sequence[str],
    *, looks: np.random.Generator, moved: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> Iterator[dict[str, np.ndarray]]:  # fmt: skip
    """Yield what there is to be seen in moments of flights, some at a time, drawn from their states.

    So images are as sharp as in flight, where recordings compress them, and as late as those of no camera.

    Args:
        names: fields that are kept. looks: draws what cameras alone notice, where the environment's tier has any of it,
            anew for each moment. moved: changes states (n, S) in which the tools are at (n, 3) m, world.
    """
    worlds = env.num_envs
    for start in range(0, len(moments), worlds):
        some = moments[start : start + worlds]
        padded = [*some, *[some[-1]] * (worlds - len(some))]
        states = np.stack([flights[k].states[step] for k, step in padded])
        if moved is not None:
            states = moved(states, np.stack([flights[k].obs["ee_pos"][step] for k, step in padded]))
        if isinstance(env, Repainted):
            obs = env.set_state_in_looks(states, looks.integers(MOST_LOOKS, size=worlds))
        else:
            obs = env.set_state(states)
        yield {name: obs[name][: len(some)].copy() for name in names}


@dataclass(frozen=True, eq=False)
class Lessons:
    """Frames as the network behind each camera learns from them.

    Attributes:
        images: (N, H, W, 3) uint8. known: (N, K). labels: of each target (N, D). visible: of each place (N,).
    """

    images: np.ndarray
    known: Tensor
    labels: Sequence[Tensor]
    visible: Sequence[Tensor | None]

    @staticmethod
    def of(eyes: Eyes, frames: Frames) -> list[Lessons]:
        """Return one for each camera."""
        made = []
        for camera in eyes.cameras:
            labels, visible = labels_of(eyes.targets.estimated, camera, frames.obs)
            known = tensor(eyes.known(frames.obs, camera.pose(frames.obs)))
            made.append(Lessons(frames.obs[camera.image], known, labels, visible))
        return made

    def batch(self, rows: np.ndarray, device: str = "cpu") -> tuple[Tensor, Tensor, list[Tensor], list[Tensor | None]]:
        """Return images, what is known, labels and what is visible in some rows (B,), on a torch device."""
        visible = [None if seen is None else seen[rows].to(device) for seen in self.visible]
        labels = [label[rows].to(device) for label in self.labels]
        return tensor(self.images[rows]).to(device), self.known[rows].to(device), labels, visible
