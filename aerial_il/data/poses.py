"""Rotations as ROS 2 writes them, for many bodies at once."""

from __future__ import annotations

import numpy as np


def quat_xyzw(rot6d: np.ndarray) -> np.ndarray:
    """Return unit quaternions (k, 4), x y z w with w >= 0, of the first two matrix columns (k, 6).

    The columns are made orthonormal first. The quaternion is the row of largest norm of 4 q qᵀ, which the matrix gives
    without a singularity (Shepperd, 1978).
    """
    a, b = rot6d[:, :3], rot6d[:, 3:]
    a = a / np.sqrt((a * a).sum(1, keepdims=True))
    b = b - (a * b).sum(1, keepdims=True) * a
    b = b / np.sqrt((b * b).sum(1, keepdims=True))
    (xx, yx, zx), (xy, yy, zy) = a.T, b.T
    xz, yz, zz = yx * zy - zx * yy, zx * xy - xx * zy, xx * yy - yx * xy
    rows = np.empty((4, 4, len(a)))
    rows[0] = 1 + xx - yy - zz, xy + yx, xz + zx, zy - yz
    rows[1] = rows[0, 1], 1 - xx + yy - zz, yz + zy, xz - zx
    rows[2] = rows[0, 2], rows[1, 2], 1 - xx - yy + zz, yx - xy
    rows[3] = rows[0, 3], rows[1, 3], rows[2, 3], 1 + xx + yy + zz
    best = np.argmax(rows[[0, 1, 2, 3], [0, 1, 2, 3]], axis=0)  # the diagonal is 4 q², so its largest marks the row
    quats = rows[best, :, np.arange(len(a))]
    return quats / (np.sqrt((quats * quats).sum(1, keepdims=True)) * np.where(quats[:, 3:] < 0, -1.0, 1.0))
