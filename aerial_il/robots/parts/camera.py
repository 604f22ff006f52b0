"""Aim a camera."""

from __future__ import annotations

import mujoco
import numpy as np

UP = (0.0, 0.0, 1.0)


def look_along(forward: np.ndarray, up: tuple[float, float, float] = UP) -> np.ndarray:
    """Quaternion (w, x, y, z) of a camera that looks along ``forward`` (3,), the image's top towards ``up``.

    Both are in the frame of the body that carries the camera; MuJoCo's cameras look along their own -z.
    """
    z = -np.asarray(forward, float) / np.linalg.norm(forward)
    x = np.cross(up, z)
    x /= np.linalg.norm(x)
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.stack([x, np.cross(z, x), z], axis=1).ravel())
    return quat
