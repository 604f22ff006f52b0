"""Cameras: colour, depth and segmentation images of one world at a time."""

from __future__ import annotations

import atexit
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any
from weakref import WeakSet

import mujoco
import numpy as np

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.specs import Field
from aerial_il.robots.parts.camera import check_size
from aerial_il.suite.timing import CONTROL_DT_S

SCENE = "scene"  # the camera that every scene has; all others are the robot's
MODALITIES = ("rgb", "depth", "segmentation")
_MEANINGS = {"rgb": "colour image", "depth": "distance along the view, m", "segmentation": "geom ids, -1 for the sky"}
ROUNDNESS = (14, 8)  # slices and stacks of balls, cylinders and capsules: drawing takes as long as there are vertices
MOST_EVERY, MOST_DELAY = 5, 10  # control steps between images, and until they are shown: 10 Hz, 200 ms
_RATE = re.compile(r"(\d+)x(\d+)|(\d+(?:\.\d+)?)(Hz|ms)")
_DTYPES = {"rgb": "uint8", "depth": "float32", "segmentation": "int32"}


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
        if not (found := _RATE.fullmatch(term)):
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


class Renderer(mujoco.Renderer):
    """MuJoCo's renderer, which spoils no other's pictures when it is freed.

    MuJoCo frees what a renderer holds on the graphics card in whatever context is current, and contexts count alike:
    an environment that was forgotten, and collected later, took textures and buffers of one still in use with it.
    """

    def render(self, *, out: np.ndarray | None = None) -> np.ndarray:
        """Return an image as MuJoCo's renderer does, and with EGL let any thread draw the next one."""
        image = super().render(out=out)
        if type(self._gl_context).__module__ == "mujoco.egl":
            from mujoco import egl

            none = egl.EGL.EGL_NO_SURFACE, egl.EGL.EGL_NO_SURFACE, egl.EGL.EGL_NO_CONTEXT
            egl.EGL.eglMakeCurrent(egl.EGL_DISPLAY, *none)
        return image

    def close(self) -> None:
        """Free what it holds, in its own context."""
        if self._gl_context is not None:
            self._gl_context.make_current()
        super().close()


class FrameRenderer:
    """Renders worlds of one model off screen, for one thread at a time.

    Args:
        model: compiled scene. height, width: pixels.
    """

    def __init__(self, model: mujoco.MjModel, height: int, width: int) -> None:
        self._model, self._size = model, (height, width)

    @cached_property
    def _renderer(self) -> Renderer:
        quality = self._model.vis.quality
        quality.numslices, quality.numstacks = ROUNDNESS
        renderer = Renderer(self._model, *self._size)
        _open.add(self)
        _close_all_at_exit()
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        return renderer

    def shoot(self, data: mujoco.MjData, request: CameraRequest, offset: np.ndarray | None = None) -> np.ndarray:
        """Return one image of ``data``, as requested, from a camera that is moved by ``offset`` (3,), m, its frame."""
        renderer = self._renderer
        renderer.disable_depth_rendering()
        renderer.disable_segmentation_rendering()
        if request.modality == "depth":
            renderer.enable_depth_rendering()
        elif request.modality == "segmentation":
            renderer.enable_segmentation_rendering()
        camera, place = data.cam(request.camera), data.cam(request.camera).xpos.copy()
        if offset is not None:
            camera.xpos[:] += camera.xmat.reshape(3, 3) @ offset
        renderer.update_scene(data, camera=request.camera)
        camera.xpos[:] = place
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
        image = renderer.render()
        if request.modality == "segmentation":
            is_geom = image[..., 1] == int(mujoco.mjtObj.mjOBJ_GEOM)
            return np.where(is_geom, image[..., 0], -1).astype(np.int32)
        return image.astype(request.dtype)

    def close(self) -> None:
        """Free the graphics context."""
        if "_renderer" in self.__dict__:
            self._renderer.close()
            del self.__dict__["_renderer"]


_open: WeakSet[FrameRenderer] = WeakSet()


@cache
def _close_all_at_exit() -> None:
    """Free what is still open when Python exits: called after MuJoCo set up its graphics, it runs before that ends."""
    atexit.register(lambda: [renderer.close() for renderer in list(_open)])
