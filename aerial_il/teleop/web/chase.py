"""A camera that follows the vehicle from behind, so that ahead on the stick is ahead in the picture.

One picture gives no depth: a plumb line from the tool to the ground shows what it is above.
"""

import math

import mujoco
import numpy as np

AZIMUTH, ELEVATION = 24.0, -24.0  # degrees: a little to the side, so that the base does not hide the tool
EASE = 0.08  # share of a turn that the camera takes up in each picture
LINE_M, DISC_M = 0.0025, 0.03
LINE_RGBA, DISC_RGBA = (0.95, 0.42, 0.1, 0.55), (0.95, 0.42, 0.1, 0.8)
GROUND_M = 0.002


class Chase:
    """Aims a free camera at one vehicle.

    Args:
        model: compiled scene, in which the base has the site ``imu`` and the tool the site ``tool``.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._base, self._tool = model.site("imu").id, model.site("tool").id
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        self._camera.elevation = ELEVATION
        self._yaw: float | None = None
        self._distance = 0.0

    def aim(self, data: mujoco.MjData) -> mujoco.MjvCamera:
        """Return the camera for the state of ``data``."""
        base, tool = data.site_xpos[self._base], data.site_xpos[self._tool]
        matrix = data.site_xmat[self._base]
        yaw = math.degrees(math.atan2(matrix[3], matrix[0]))
        if self._yaw is None:
            self._yaw, self._distance = yaw, 0.9 + 2.0 * float(np.linalg.norm(tool - base))
        self._yaw += EASE * ((yaw - self._yaw + 180.0) % 360.0 - 180.0)
        self._camera.lookat[:] = 0.35 * base + 0.65 * tool
        self._camera.azimuth, self._camera.distance = self._yaw + AZIMUTH, self._distance
        return self._camera

    def draw_plumb_line(self, scene: mujoco.MjvScene, data: mujoco.MjData) -> None:
        """Add a line from the tool down to the ground, and a disc where it ends, to what is about to be rendered."""
        tool = np.array(data.site_xpos[self._tool])
        foot = np.array([tool[0], tool[1], GROUND_M])
        line = _next_geom(scene, LINE_RGBA)
        disc = _next_geom(scene, DISC_RGBA)
        if line is None or disc is None:
            return
        mujoco.mjv_connector(line, mujoco.mjtGeom.mjGEOM_CYLINDER, LINE_M, tool, foot)
        mujoco.mjv_connector(disc, mujoco.mjtGeom.mjGEOM_CYLINDER, DISC_M, foot, foot + np.array([0.0, 0.0, GROUND_M]))


def _next_geom(scene: mujoco.MjvScene, rgba: tuple[float, ...]) -> mujoco.MjvGeom | None:
    """Return a new decorative geom of the scene, None if it is full."""
    if scene.ngeom >= scene.maxgeom:
        return None
    geom = scene.geoms[scene.ngeom]
    scene.ngeom += 1
    kind, size, pos, mat = mujoco.mjtGeom.mjGEOM_CYLINDER, np.ones(3), np.zeros(3), np.eye(3).ravel()
    mujoco.mjv_initGeom(geom, kind, size, pos, mat, np.array(rgba, np.float32))
    return geom
