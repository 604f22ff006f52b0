"""Cameras of n worlds: when each takes its images, and when they are shown."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from aerial_il.suite.cameras import CameraRequest


class Rig:
    """Images of n worlds: taken in every so many control steps of an episode, and shown until the next one is.

    Where images are shown late, the one with which the episode started or was continued precedes them.

    Args:
        requests: the cameras. worlds: n.
        shoot: takes the images of one world, as it stands, that it is given the requests of.
    """

    def __init__(
        self,
        requests: Sequence[CameraRequest],
        worlds: int,
        shoot: Callable[[int, Sequence[CameraRequest]], Iterable[np.ndarray]],
    ) -> None:
        self._requests, self._shoot, self._everyone = requests, shoot, np.arange(worlds)
        self._kept = {r.key: np.zeros((worlds, _slots(r), *r.shape), r.dtype) for r in requests}

    def start(self, worlds: Iterable[int]) -> None:
        """Take the first images of some worlds, whose episodes start or are continued from a state."""
        for world in worlds if self._requests else ():
            for request, image in zip(self._requests, self._shoot(world, self._requests), strict=True):
                self._kept[request.key][world] = image

    def advance(self, worlds: Iterable[int], steps: np.ndarray) -> None:
        """Take the images that are due in some worlds, after (n,) control steps of each episode."""
        for world, step in ((world, steps.item(world)) for world in worlds if self._requests):
            due = [request for request in self._requests if step % request.every == 0]
            for request, image in zip(due, self._shoot(world, due) if due else (), strict=True):
                self._kept[request.key][world, _slot(request, step)] = image

    def shown(self, steps: np.ndarray) -> dict[str, np.ndarray]:
        """Copies of the images (n, ...) by name that all worlds show after ``steps`` (n,)."""
        return {r.key: self._kept[r.key][self._everyone, _slot(r, steps - r.delay)] for r in self._requests}

    def anew(self) -> dict[str, np.ndarray]:
        """Images of all worlds as they stand; what they go on to show stays as it is."""
        taken = [self._shoot(world, self._requests) for world in range(len(self._everyone))] if self._requests else []
        return {r.key: np.stack(images) for r, images in zip(self._requests, zip(*taken, strict=True), strict=True)}


def _slots(request: CameraRequest) -> int:
    """Images that are kept: the one that is shown and those on their way."""
    return -(-request.delay // request.every) + 1


def _slot[Step: (int, np.ndarray)](request: CameraRequest, step: Step) -> Step:
    """Place of the image that was the last to be taken at a step."""
    return step // request.every % _slots(request)
