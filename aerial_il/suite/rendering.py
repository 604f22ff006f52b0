"""Cameras: colour, depth and segmentation images of one world at a time."""

from __future__ import annotations

import atexit
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import NamedTuple
from weakref import WeakSet

import mujoco
import numpy as np

from aerial_il.core.rendering import require_rendering
from aerial_il.core.seeding import named_rng
from aerial_il.suite.cameras import CameraRequest
from aerial_il.suite.disturbances.lens import through_lens
from aerial_il.suite.disturbances.nominal import CAMERA_OFFSET, CAMERA_TURN, LENS, LIGHTS, PAINT, SHAPES, SHAPES_SIZE

ROUNDNESS = (14, 8)  # slices and stacks of balls, cylinders and capsules: drawing takes as long as there are vertices
HIDDEN = 5  # a group of geoms that is not drawn
NO_SHAPES = np.zeros((0, SHAPES_SIZE))


class View(NamedTuple):
    """What a camera can see: what lies outside need not be drawn, which would take as long.

    Attributes:
        pos: (3,) m, and mat: (3, 3) of the camera, world. tall, wide: tangents of half its angles.
    """

    pos: np.ndarray
    mat: np.ndarray
    tall: float
    wide: float

    @staticmethod
    def of(model: mujoco.MjModel, data: mujoco.MjData, camera: int, aspect: float) -> View:
        """Return the view of a camera of ``data`` in pictures of ``aspect``, width over height."""
        tall = float(np.tan(0.5 * np.radians(model.cam_fovy[camera])))
        return View(data.cam_xpos[camera].copy(), data.cam_xmat[camera].reshape(3, 3).copy(), tall, tall * aspect)

    def of_balls(self, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """Return which balls at ``centres`` (k, 3) with ``radii`` (k,), m, may be in view, (k,) bool."""
        right, up, back = ((centres - self.pos) @ self.mat).T
        inside = np.abs(up) + self.tall * back < radii * np.hypot(1.0, self.tall)
        inside &= np.abs(right) + self.wide * back < radii * np.hypot(1.0, self.wide)
        return inside & (back < radii)


@dataclass(frozen=True)
class Sight:
    """How a world is seen that is not as it should be.

    Attributes:
        fields: of :data:`aerial_il.suite.disturbances.nominal.SEEN`, by name. cameras: names of the robot's, which the
            rows of some of them stand for. seed, step: of the moment.
    """

    fields: Mapping[str, np.ndarray] = field(default_factory=dict)
    cameras: tuple[str, ...] = ()
    seed: int = 0
    step: int = 0

    def of(self, name: str, camera: str) -> np.ndarray | None:
        """Return the row of a field that is the robot's ``camera``'s; None if that is as it should be."""
        there = name in self.fields and camera in self.cameras
        return self.fields[name][self.cameras.index(camera)] if there else None

    def place(self, data: mujoco.MjData, camera: int, name: str) -> None:
        """Move and turn a camera of ``data``."""
        if (offset := self.of(CAMERA_OFFSET, name)) is not None:
            data.cam_xpos[camera] += data.cam_xmat[camera].reshape(3, 3) @ offset
        if (turn := self.of(CAMERA_TURN, name)) is not None:
            quat, mat = np.empty(4), np.empty(9)
            mujoco.mju_axisAngle2Quat(quat, turn / max(float(np.linalg.norm(turn)), 1e-12), float(np.linalg.norm(turn)))
            mujoco.mju_quat2Mat(mat, quat)
            data.cam_xmat[camera] = (data.cam_xmat[camera].reshape(3, 3) @ mat.reshape(3, 3)).ravel()

    def paint(self, model: mujoco.MjModel) -> None:
        """Give a model that is drawn its colours and textures."""
        for name in PAINT:
            if name in self.fields:
                getattr(model, name)[:] = self.fields[name]

    def arrange(self, scene: mujoco.MjvScene, view: View) -> None:
        """Give what is about to be drawn its lights, and the solids in view that are for eyes alone."""
        if LIGHTS in self.fields:
            head, sun = scene.lights[0], scene.lights[1]
            head.ambient, head.diffuse, sun.diffuse, direction = self.fields[LIGHTS]
            sun.dir = direction / np.linalg.norm(direction)
        shapes = self.fields.get(SHAPES, NO_SHAPES)
        for row in shapes[view.of_balls(shapes[:, 4:7], np.linalg.norm(shapes[:, 1:4], axis=1))]:
            solid, rgba = scene.geoms[scene.ngeom], np.append(row[16:], 1.0).astype(np.float32)
            mujoco.mjv_initGeom(solid, int(row[0]), row[1:4], row[4:7], row[7:16], rgba)
            solid.segid = -1
            scene.ngeom += 1

    def taken(self, image: np.ndarray, camera: str) -> np.ndarray:
        """Return a colour image (H, W, 3) as a camera takes it."""
        lens = self.of(LENS, camera)
        return (
            image if lens is None else through_lens(image, lens, named_rng(self.seed, "lens", camera, str(self.step)))
        )


AS_IT_IS = Sight()


class Renderer(mujoco.Renderer):
    """MuJoCo's renderer, which spoils no other's pictures when it is freed.

    MuJoCo frees what a renderer holds on the graphics card in whatever context is current, and contexts count alike:
    an environment that was forgotten, and collected later, took textures and buffers of one still in use with it.
    """

    def __init__(self, model: mujoco.MjModel, height: int, width: int) -> None:
        require_rendering("looking at the scene")
        super().__init__(model, height, width)

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
        if getattr(self, "_gl_context", None) is not None:  # else it was refused, or is closed
            self._gl_context.make_current()
            super().close()


class FrameRenderer:
    """Renders worlds of one model off screen, for one thread at a time.

    Args:
        model: compiled scene, of which it has a copy. height, width: pixels.
    """

    def __init__(self, model: mujoco.MjModel, height: int, width: int) -> None:
        self._scene, self._size = model, (height, width)

    @cached_property
    def _model(self) -> mujoco.MjModel:
        model = copy(self._scene)
        model.vis.quality.numslices, model.vis.quality.numstacks = ROUNDNESS
        return model

    @cached_property
    def _renderer(self) -> Renderer:
        renderer = Renderer(self._model, *self._size)
        _open.add(self)
        _close_all_at_exit()
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        return renderer

    def shoot(self, data: mujoco.MjData, request: CameraRequest, sight: Sight = AS_IT_IS) -> np.ndarray:
        """Return one image of ``data``, as requested, seen as ``sight`` says."""
        renderer, camera = self._renderer, self._ids[request.camera]
        self._show(request.modality)
        sight.paint(self._model)
        pos, mat = data.cam_xpos[camera].copy(), data.cam_xmat[camera].copy()
        sight.place(data, camera, request.camera)
        view = View.of(self._model, data, camera, self._size[1] / self._size[0])
        seen = view.of_balls(data.geom_xpos, self._model.geom_rbound) | (self._model.geom_rbound == 0.0)  # no end
        self._model.geom_group[:] = np.where(seen, self._scene.geom_group, HIDDEN)
        renderer.update_scene(data, camera=camera)
        data.cam_xpos[camera], data.cam_xmat[camera] = pos, mat
        sight.arrange(renderer.scene, view)
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
        image = renderer.render()
        if request.modality == "segmentation":
            is_geom = image[..., 1] == int(mujoco.mjtObj.mjOBJ_GEOM)
            return np.where(is_geom, image[..., 0], -1).astype(np.int32)
        return sight.taken(image, request.camera) if request.modality == "rgb" else image

    def _show(self, modality: str) -> None:
        self._renderer.disable_depth_rendering()
        self._renderer.disable_segmentation_rendering()
        if modality == "depth":
            self._renderer.enable_depth_rendering()
        elif modality == "segmentation":
            self._renderer.enable_segmentation_rendering()

    @cached_property
    def _ids(self) -> dict[str, int]:
        return {self._model.camera(i).name: i for i in range(self._model.ncam)}

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
