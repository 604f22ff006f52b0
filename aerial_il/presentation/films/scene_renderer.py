"""Draws recorded states: for people in the look of the studio, from where all is seen; or as the robot's cameras do."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from types import TracebackType

import mujoco
import numpy as np
from PIL import Image

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.rendering import can_render
from aerial_il.core.scene_gate import compiled
from aerial_il.presentation.studio.marks import Mark
from aerial_il.presentation.studio.studio import MOVING, Studio
from aerial_il.presentation.studio.viewpoint import ELEVATION_DEG, Viewpoint
from aerial_il.suite.physics.physics_batch import STATE
from aerial_il.suite.rendering import Renderer

FRAMED = 12  # states, by which the viewpoint is chosen that holds a whole flight
SUPERSAMPLING = 2  # every pixel is the mean of 2 x 2
BELOW_M = 0.2  # what stands farther below the robot, such as a table's leg, need not be seen
FAR_M = 3.4  # where the camera ``scene`` is farther off than this, a task wants all of it seen


def obstacle() -> str:
    """Return why this machine cannot draw, in the words of its graphics, or an empty string."""
    if not can_render():
        return "no rendering back end works on this machine; `aerial-il doctor` says what is missing."
    try:
        Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 16, 16).close()
    except Exception as error:  # the renderer, its bindings and the driver each raise their own kind
        return f"this machine cannot render ({type(error).__name__}: {error}). `aerial-il doctor` says what is missing."
    return ""


class SceneRenderer:
    """Pictures of the states of one scene; close it, or use it as a context.

    Args:
        model_xml: the compiled scene, as environments and recordings keep it.
    """

    def __init__(self, model_xml: str) -> None:
        try:
            self.model, self._xml = compiled(model_xml), model_xml
        except InvalidValueError as error:
            hint = "Its states and actions can be seen all the same: aerial-il info PATH"
            raise InvalidValueError(f"The recorded scene cannot be drawn: {error}. {hint}") from error
        self.data = mujoco.MjData(self.model)
        self._renderers: dict[tuple[int, int], Renderer] = {}

    def __enter__(self) -> SceneRenderer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self.close()

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the scene's own cameras."""
        return tuple(self.model.camera(i).name for i in range(self.model.ncam))

    @cached_property
    def studio(self) -> Studio:
        """The copy of the scene that people see."""
        return Studio(self.model, self._xml)

    def pose(self, state: np.ndarray) -> mujoco.MjData:
        """Put the scene into a full state (S,) and return it."""
        mujoco.mj_setState(self.model, self.data, state, STATE)
        mujoco.mj_forward(self.model, self.data)
        return self.data

    def draw(
        self, state: np.ndarray, camera: str | Viewpoint, height: int, width: int, *, exposures: int = MOVING,
        marks: Sequence[Mark] = (),
    ) -> np.ndarray:  # fmt: skip
        """Return the picture (height, width, 3) uint8 of a state (S,).

        Args:
            state: of the scene. camera: a viewpoint, in the look of the studio; or a camera of the scene, as it sees.
            height, width: pixels. exposures: of a picture from a viewpoint; more are smoother and take longer.
            marks: added to a picture from a viewpoint.
        """
        if isinstance(camera, Viewpoint):
            return self.studio.draw(state, camera, height, width, exposures=exposures, marks=marks)
        data, renderer = self.pose(state), self._renderer(height, width)
        renderer.update_scene(data, camera)
        for effect in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            renderer.scene.flags[effect] = False
        return np.asarray(Image.fromarray(renderer.render()).reduce(SUPERSAMPLING))

    def hide_props(self) -> None:
        """Leave the robot alone with the ground in what people see."""
        model = self.studio.model
        ground = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        model.geom_rgba[~robot_geoms(model) & ~ground, 3] = 0.0
        model.site_rgba[:, 3] = 0.0

    def frame(
        self, states: Sequence[np.ndarray] | np.ndarray, aspect: float, *, props: bool = True, turn_deg: float = 0.0,
        elevation_deg: float = ELEVATION_DEG,
    ) -> Viewpoint:  # fmt: skip
        """Return the viewpoint, on the side of the ``scene`` camera, that just holds the robot in all ``states``.

        Args:
            states: full states (S,); of many a dozen are looked at. aspect: width of the picture over its height.
            props: hold the props too that are not far below, by their centres: a table may reach beyond the picture, a
                button may not.
            turn_deg: round the scene from there, anticlockwise from above. elevation_deg: of the line of sight.
        """
        some = states[:: max(1, len(states) // FRAMED)]
        points = np.concatenate([self._extent(self.pose(state), props) for state in some])
        return Viewpoint((0.0, 0.0, 0.0), 1.0, self._azimuth() + turn_deg, elevation_deg).holding(points, aspect)

    def close(self) -> None:
        """Free the graphics contexts."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()
        if "studio" in self.__dict__:
            self.studio.close()

    def _renderer(self, height: int, width: int) -> Renderer:
        if (height, width) not in self._renderers:
            size = SUPERSAMPLING * height, SUPERSAMPLING * width
            self._renderers[height, width] = Renderer(self.model, *size)
        return self._renderers[height, width]

    def _azimuth(self) -> float:
        model = self.model
        if "scene" not in self.cameras:
            return 130.0
        mujoco.mj_forward(model, self.data)
        x, y, _ = -self.data.cam_xmat[model.camera("scene").id].reshape(3, 3)[:, 2]
        return float(np.rad2deg(np.arctan2(y, x)))

    @cached_property
    def _wide(self) -> bool:
        """Whether the scene is larger than a table."""
        x, y, _ = self.model.cam_pos[self.model.camera("scene").id] if "scene" in self.cameras else (0.0, 0.0, 0.0)
        return bool(np.hypot(x, y) > FAR_M)

    def _extent(self, data: mujoco.MjData, props: bool) -> np.ndarray:
        """(P, 3) corners of the robot's geoms, and the centres of those of the props."""
        model = self.model
        seen = model.geom_rgba[:, 3] > 0.0
        robot = robot_geoms(model)
        own = np.flatnonzero(robot & seen)
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
        centre, half = model.geom_aabb[own, :3], model.geom_aabb[own, 3:]
        corners = centre[:, None] + signs * half[:, None]
        turned = np.einsum("gij,gkj->gki", data.geom_xmat[own].reshape(-1, 3, 3), corners)
        points = [(data.geom_xpos[own][:, None] + turned).reshape(-1, 3)]
        if props:
            others = ~robot & seen & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
            centres, lowest = data.geom_xpos[others], points[0][:, 2].min()
            points.append(centres[(centres[:, 2] > lowest - BELOW_M) | self._wide])
        return np.concatenate(points)


def robot_geoms(model: mujoco.MjModel) -> np.ndarray:
    """Return (G,) bool: the geom belongs to the robot, whose first body is ``base``."""
    return model.body_rootid[model.geom_bodyid] == model.body_rootid[model.body("base").id]
