"""Free cameras, and where they must stand for a picture to hold what is to be seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np

ELEVATION_DEG = -22.0
MARGIN = 1.12  # air around what is framed
FOV_DEG = 45.0  # upright; MuJoCo's for free cameras


@dataclass(frozen=True)
class Viewpoint:
    """A free camera.

    Attributes:
        centre: point looked at, world, m. distance: from it, m. azimuth_deg, elevation_deg: MuJoCo's angles of view.
    """

    centre: tuple[float, float, float]
    distance: float
    azimuth_deg: float
    elevation_deg: float = ELEVATION_DEG

    @property
    def axes(self) -> np.ndarray:
        """(3, 3) rows: to the right, upwards and forward in the picture, in the world."""
        a, e = np.deg2rad([self.azimuth_deg, self.elevation_deg])
        forward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        right = np.array([np.sin(a), -np.cos(a), 0.0])
        return np.stack([right, np.cross(right, forward), forward])

    def camera(self) -> mujoco.MjvCamera:
        camera = mujoco.MjvCamera()
        camera.lookat[:], camera.distance = self.centre, self.distance
        camera.azimuth, camera.elevation = self.azimuth_deg, self.elevation_deg
        return camera

    def holding(self, points: np.ndarray, aspect: float) -> Viewpoint:
        """Return the viewpoint of the same angles that just holds ``points`` (P, 3) m in a picture of ``aspect``."""
        local = points @ self.axes.T
        half = np.tan(0.5 * np.deg2rad(FOV_DEG)) * np.array([aspect, 1.0])
        middle = 0.5 * (local.min(axis=0) + local.max(axis=0))
        for _ in range(4):  # nearer points stand farther out: centre what the picture shows, not what is there
            distance = float(np.max(np.abs(local[:, :2] - middle[:2]) * MARGIN / half - (local[:, 2:] - middle[2])))
            depth = local[:, 2] - middle[2] + distance
            shown = (local[:, :2] - middle[:2]) / depth[:, None]
            middle[:2] += 0.5 * (shown.min(axis=0) + shown.max(axis=0)) * distance
        distance = float(np.max(np.abs(local[:, :2] - middle[:2]) * MARGIN / half - (local[:, 2:] - middle[2])))
        x, y, z = (middle @ self.axes).tolist()
        return replace(self, centre=(x, y, z), distance=distance)
