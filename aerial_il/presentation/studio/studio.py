"""The studio: states of a scene drawn for people, with shadows, smooth edges and turning propellers."""

from collections.abc import Sequence
from functools import partial

import mujoco
import numpy as np

from aerial_il.presentation.studio.exposure import expose
from aerial_il.presentation.studio.marks import Mark
from aerial_il.presentation.studio.propellers import propellers, turn
from aerial_il.presentation.studio.stage import staged
from aerial_il.presentation.studio.viewpoint import Viewpoint
from aerial_il.suite.physics.physics_batch import STATE
from aerial_il.suite.rendering import Renderer

STILL, MOVING, QUICK = 16, 4, 1  # exposures of a picture that stands, of one in a film, of one that must not take long
FINE, COARSE = 2048, 1024  # pixels of shadows, each way


class Studio:
    """Pictures of the states of one scene; close it after use.

    Args:
        model: compiled scene. xml: that it was compiled from.
    """

    def __init__(self, model: mujoco.MjModel, xml: str) -> None:
        self.model = staged(model, xml)
        self.data = mujoco.MjData(self.model)
        self._propellers = propellers(self.model)
        self._renderers: dict[tuple[int, ...], Renderer] = {}

    def pose(self, state: np.ndarray) -> mujoco.MjData:
        """Put the stage into a full state (S,) of the scene and return it."""
        mujoco.mj_setState(self.model, self.data, state, STATE)
        mujoco.mj_forward(self.model, self.data)
        return self.data

    def draw(
        self, state: np.ndarray, view: Viewpoint, height: int, width: int, *, exposures: int = MOVING,
        marks: Sequence[Mark] = (),
    ) -> np.ndarray:  # fmt: skip
        """Return the picture (height, width, 3) uint8 of a state (S,), the mean of so many exposures, with marks."""
        data = self.pose(state)
        renderer = self._renderer(
            height, width, shadow_pixels=FINE if exposures >= STILL else COARSE, samples=4 if exposures < MOVING else 0
        )
        prepare = partial(self._prepare, renderer, view, marks, data.geom_xmat.copy())
        return expose(renderer, exposures, np.array(view.centre), prepare)

    def close(self) -> None:
        """Free the graphics contexts."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()

    def _prepare(
        self, renderer: Renderer, view: Viewpoint, marks: Sequence[Mark], still: np.ndarray, share: float
    ) -> None:
        turn(self.data, self._propellers, still, share)
        renderer.update_scene(self.data, view.camera())
        for mark in marks:
            mark.add_to(renderer.scene, self.model)

    def _renderer(self, height: int, width: int, *, shadow_pixels: int, samples: int) -> Renderer:
        key = height, width, shadow_pixels, samples
        if key not in self._renderers:
            quality = self.model.vis.quality
            quality.shadowsize, quality.offsamples = shadow_pixels, samples
            self._renderers[key] = Renderer(self.model, height, width)
        return self._renderers[key]
