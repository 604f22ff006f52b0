"""Rotations as ROS 2 writes them, for many bodies at once."""

import numpy as np

from aerial_il.core.kernels import kernel


@kernel
def quat_xyzw(rot6d: np.ndarray) -> np.ndarray:
    """Return unit quaternions (k, 4), x y z w with w >= 0, of the first two matrix columns (k, 6).

    The columns are made orthonormal first. The quaternion is the row of largest norm of 4 q qᵀ, which the matrix gives
    without a singularity (Shepperd, 1978).
    """
    quats = np.empty((len(rot6d), 4))
    for i in range(len(rot6d)):
        xx, yx, zx, xy, yy, zy = rot6d[i]
        norm = np.sqrt(xx * xx + yx * yx + zx * zx)
        xx, yx, zx = xx / norm, yx / norm, zx / norm
        along = xx * xy + yx * yy + zx * zy
        xy, yy, zy = xy - along * xx, yy - along * yx, zy - along * zx
        norm = np.sqrt(xy * xy + yy * yy + zy * zy)
        xy, yy, zy = xy / norm, yy / norm, zy / norm
        xz, yz, zz = yx * zy - zx * yy, zx * xy - xx * zy, xx * yy - yx * xy
        x2, y2, z2, w2 = 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz
        most = max(x2, y2, z2, w2)
        if x2 == most:
            x, y, z, w = x2, xy + yx, xz + zx, zy - yz
        elif y2 == most:
            x, y, z, w = xy + yx, y2, yz + zy, xz - zx
        elif z2 == most:
            x, y, z, w = xz + zx, yz + zy, z2, yx - xy
        else:
            x, y, z, w = zy - yz, xz - zx, yx - xy, w2
        norm = np.sqrt(x * x + y * y + z * z + w * w)
        norm = -norm if w < 0 else norm
        quats[i, 0], quats[i, 1], quats[i, 2], quats[i, 3] = x / norm, y / norm, z / norm, w / norm
    return quats
