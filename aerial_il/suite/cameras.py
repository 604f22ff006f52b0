"""Images that are asked for: of which camera, how large, how often and how late."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.specs import Field
from aerial_il.robots.parts.camera import check_size
from aerial_il.suite.timing import CONTROL_DT_S

SCENE = "scene"  # the camera that every scene has; all others are the robot's
MODALITIES = ("rgb", "depth", "segmentation")
MOST_EVERY, MOST_DELAY = 5, 10  # control steps between images, and until they are shown: 10 Hz, 200 ms
_MEANINGS = {"rgb": "colour image", "depth": "distance along the view, m", "segmentation": "geom ids, -1 for the sky"}
_DTYPES = {"rgb": "uint8", "depth": "float32", "segmentation": "int32"}
_TERM = re.compile(r"(\d+)x(\d+)|(\d+(?:\.\d+)?)(Hz|ms)")


@dataclass(frozen=True)
class CameraRequest:
    """A camera and what it should see: ``rgb`` (H, W, 3), ``depth`` in m (H, W) or geom ids (H, W), -1 for the sky.

    Attributes:
        size: height and width, pixels. every: control steps from one image to the next. delay: control steps between
            an image and its being shown.
    """

    camera: str
    modality: str
    size: tuple[int, int]
    every: int = 1
    delay: int = 0

    def __post_init__(self) -> None:
        if self.modality not in MODALITIES:
            raise UnknownNameError("image modality", self.modality, MODALITIES)

    @property
    def key(self) -> str:
        """Name of the image among the observations."""
        return f"{self.camera}_{self.modality}"

    @property
    def field(self) -> Field:
        """What a specification says of it."""
        return Field(
            self.key, self.shape, "image", self.dtype, frame=f"camera {self.camera}",
            meaning=_MEANINGS[self.modality], every=self.every, delay=self.delay,
        )  # fmt: skip

    @property
    def dtype(self) -> str:
        return _DTYPES[self.modality]

    @property
    def shape(self) -> tuple[int, ...]:
        """Of one image."""
        return (*self.size, 3) if self.modality == "rgb" else self.size


def parse_cameras(cameras: Sequence[str], request: Callable[..., CameraRequest]) -> tuple[CameraRequest, ...]:
    """Read camera requests written as ``wrist``, ``wrist:depth`` or ``wrist@64x64@25Hz@40ms``.

    Behind ``@`` stand, each if it is not the default, the image's height and width, how many are taken in a second, and
    how long after being taken they are shown.

    Args:
        request: makes one of the name of a camera and, perhaps, a modality, ``size``, ``every`` and ``delay``.

    Raises:
        UnknownNameError: unknown camera or modality. InvalidValueError: one camera image asked for twice, or a size,
            rate or delay that is not possible.
    """
    if isinstance(cameras, str):
        raise InvalidValueError(f"cameras is a list of names, got the text {cameras!r}; write cameras=({cameras!r},).")
    requests = tuple(_parsed(text, request) for text in cameras)
    if len({each.key for each in requests}) < len(requests):
        raise InvalidValueError(f"Each camera image can be asked for once, got {', '.join(cameras)}.")
    return requests


def _parsed(text: str, request: Callable[..., CameraRequest]) -> CameraRequest:
    name, *terms = text.split("@")
    said: dict[str, Any] = {}
    for term in terms:
        if not (found := _TERM.fullmatch(term)):
            raise InvalidValueError(f"{text}: {term!r} is neither a size, 64x64, nor a rate, 25Hz, nor a delay, 40ms.")
        height, width, number, unit = found.groups()
        if unit is None:
            said["size"] = int(height), int(width)
            check_size(said["size"])
        elif unit == "Hz":
            said["every"] = _every(text, float(number))
        else:
            said["delay"] = _delay(text, float(number))
    return request(*name.split(":", 1), **said)


def _every(text: str, rate: float) -> int:
    """Return the control steps from one image to the next at ``rate``, Hz, which may be rounded: 16.7."""
    possible = {every: 1.0 / (every * CONTROL_DT_S) for every in range(1, MOST_EVERY + 1)}
    for every, exact in possible.items():
        if abs(rate - exact) < 0.01 * exact:
            return every
    choices = ", ".join(f"{exact:.3g}Hz" for exact in possible.values())
    raise InvalidValueError(f"{text}: images are taken every so many control steps of 20 ms, at {choices}.")


def _delay(text: str, delay_ms: float) -> int:
    steps = delay_ms / (1000.0 * CONTROL_DT_S)
    if steps != round(steps) or steps > MOST_DELAY:
        most = 1000.0 * CONTROL_DT_S * MOST_DELAY
        raise InvalidValueError(f"{text}: images are late by whole control steps of 20 ms, 0 to {most:g}ms.")
    return round(steps)
