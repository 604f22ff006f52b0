"""Cameras: colour, depth and segmentation images of one world at a time."""

from __future__ import annotations

import atexit
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from weakref import WeakSet

import mujoco
import numpy as np

from aerial_il.core.errors import InvalidValueError, UnknownNameError

SCENE = "scene"  # the camera that every scene has; all others are the robot's
MODALITIES = ("rgb", "depth", "segmentation")
_MEANINGS = {"rgb": "colour image", "depth": "distance along the view, m", "segmentation": "geom ids, -1 for the sky"}
ROUNDNESS = (14, 8)  # slices and stacks of balls, cylinders and capsules: drawing takes as long as there are vertices
_DTYPES = {"rgb": "uint8", "depth": "float32", "segmentation": "int32"}


@dataclass(frozen=True)
class CameraRequest:
    """A camera and what it should see: ``rgb`` (H, W, 3), ``depth`` in m (H, W) or geom ids (H, W), -1 for the sky.

    Attributes:
        size: height and width, pixels.
    """

    camera: str
    modality: str
    size: tuple[int, int]

    def __post_init__(self) -> None:
        if self.modality not in MODALITIES:
            raise UnknownNameError("image modality", self.modality, MODALITIES)

    @property
    def key(self) -> str:
        """Name of the image among the observations."""
        return f"{self.camera}_{self.modality}"

    @property
    def meaning(self) -> str:
        return _MEANINGS[self.modality]

    @property
    def dtype(self) -> str:
        return _DTYPES[self.modality]

    @property
    def shape(self) -> tuple[int, ...]:
        """Of one image."""
        return (*self.size, 3) if self.modality == "rgb" else self.size


def parse_cameras(cameras: Sequence[str], request: Callable[..., CameraRequest]) -> tuple[CameraRequest, ...]:
    """Read camera requests written as ``"wrist"`` or ``"wrist:depth"``.

    Args:
        request: makes one of the name of a camera and, perhaps, a modality.

    Raises:
        UnknownNameError: unknown camera or modality. InvalidValueError: one camera image asked for twice.
    """
    if isinstance(cameras, str):
        raise InvalidValueError(f"cameras is a list of names, got the text {cameras!r}; write cameras=({cameras!r},).")
    requests = tuple(request(*text.split(":", 1)) for text in cameras)
    if len(set(requests)) < len(requests):
        raise InvalidValueError(f"Each camera image can be asked for once, got {', '.join(cameras)}.")
    return requests


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
