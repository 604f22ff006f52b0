"""Vectors, quaternions and rotation matrices as plain tuples, for compiled code and for reading.

Vectors are ``(x, y, z)``; quaternions are ``(w, x, y, z)`` of unit norm, MuJoCo's order; matrices are nine numbers,
row by row. ``rot_a_from_b`` maps coordinates in frame b to coordinates in frame a.
"""

import math

import numpy as np

from aerial_il.core.kernels import kernel

IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@kernel
def add(a, b):
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@kernel
def sub(a, b):
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@kernel
def scale(s, a):
    return (s * a[0], s * a[1], s * a[2])


@kernel
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@kernel
def norm(a):
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@kernel
def planar_norm(a):
    """Horizontal length of a vector."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1])


@kernel
def closeness(distance, scale):
    """Smooth reward for a distance: 1 at zero, 1/2 at ``scale``, never negative (a rational bell)."""
    ratio = distance / scale
    return 1.0 / (1.0 + ratio * ratio)


@kernel
def limit_norm(a, longest):
    """Shorten vector ``a`` to at most ``longest``, keeping its direction."""
    length = norm(a)
    if length <= longest:
        return a
    return scale(longest / length, a)


@kernel
def rotate(m, v):
    """Return ``M v``."""
    return (
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
        m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
        m[6] * v[0] + m[7] * v[1] + m[8] * v[2],
    )


@kernel
def rotate_back(m, v):
    """Return ``Mᵀ v``."""
    return (
        m[0] * v[0] + m[3] * v[1] + m[6] * v[2],
        m[1] * v[0] + m[4] * v[1] + m[7] * v[2],
        m[2] * v[0] + m[5] * v[1] + m[8] * v[2],
    )


@kernel
def matmul(a, b):
    """Return ``A B``."""
    return (
        a[0] * b[0] + a[1] * b[3] + a[2] * b[6],
        a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
        a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
        a[3] * b[0] + a[4] * b[3] + a[5] * b[6],
        a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
        a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
        a[6] * b[0] + a[7] * b[3] + a[8] * b[6],
        a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
        a[6] * b[2] + a[7] * b[5] + a[8] * b[8],
    )


@kernel
def matmul_back(a, b):
    """Return ``Aᵀ B``."""
    return matmul((a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]), b)


@kernel
def column(m, j):
    """Return column ``j`` of a matrix."""
    if j == 0:
        return (m[0], m[3], m[6])
    if j == 1:
        return (m[1], m[4], m[7])
    return (m[2], m[5], m[8])


@kernel
def from_columns(x, y, z):
    """Build a matrix from its three columns."""
    return (x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2])


@kernel
def mat_from_quat(q):
    """Rotation matrix of a unit quaternion (w, x, y, z)."""
    w, x, y, z = q
    return (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )


@kernel
def mat_from_axis_angle(axis, angle):
    """Rodrigues' formula for a unit ``axis`` and an ``angle`` in rad."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = axis
    k = 1.0 - c
    return (
        c + k * x * x,
        k * x * y - s * z,
        k * x * z + s * y,
        k * x * y + s * z,
        c + k * y * y,
        k * y * z - s * x,
        k * x * z - s * y,
        k * y * z + s * x,
        c + k * z * z,
    )


@kernel
def mat_from_yaw(yaw):
    """Rotation by ``yaw`` rad about the vertical."""
    c, s = math.cos(yaw), math.sin(yaw)
    return (c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)


@kernel
def euler_from_mat(m):
    """Roll, pitch and yaw (rad) of ``M = Rz(yaw) Ry(pitch) Rx(roll)``."""
    return math.atan2(m[7], m[8]), math.atan2(-m[6], math.sqrt(m[0] * m[0] + m[3] * m[3])), math.atan2(m[3], m[0])


@kernel
def mat_from_rotvec(v):
    """Exponential map of a rotation vector in rad."""
    angle = norm(v)
    if angle < 1e-12:
        return (1.0, -v[2], v[1], v[2], 1.0, -v[0], -v[1], v[0], 1.0)
    return mat_from_axis_angle(scale(1.0 / angle, v), angle)


@kernel
def rotvec_from_mat(m):
    """Logarithm of a rotation matrix: the rotation vector in rad, with angle in [0, π]."""
    half = (0.5 * (m[7] - m[5]), 0.5 * (m[2] - m[6]), 0.5 * (m[3] - m[1]))
    sine, cosine = norm(half), 0.5 * (m[0] + m[4] + m[8] - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > 1e-8:
        return scale(angle / sine, half)
    if cosine > 0.0:
        return half
    # Half a turn: the axis is the longest column of (M + I) / 2.
    xx, yy, zz = 0.5 * (m[0] + 1.0), 0.5 * (m[4] + 1.0), 0.5 * (m[8] + 1.0)
    if xx >= yy and xx >= zz:
        axis = (xx, 0.25 * (m[1] + m[3]), 0.25 * (m[2] + m[6]))
    elif yy >= zz:
        axis = (0.25 * (m[1] + m[3]), yy, 0.25 * (m[5] + m[7]))
    else:
        axis = (0.25 * (m[2] + m[6]), 0.25 * (m[5] + m[7]), zz)
    return scale(angle / norm(axis), axis)


@kernel
def orthonormalise(x, y):
    """Rotation matrix from two (possibly skew) columns, by Gram–Schmidt (Zhou et al. 2019, "rot6d").

    Falls back to the identity's columns where the two are zero or parallel.
    """
    length = norm(x)
    if length < 1e-6:
        x, length = (1.0, 0.0, 0.0), 1.0
    x = scale(1.0 / length, x)
    y = sub(y, scale(dot(x, y), x))
    length = norm(y)
    if length < 1e-6:
        y = (-x[1], x[0], 0.0) if abs(x[2]) < 0.9 else (0.0, 1.0, 0.0)
        y = sub(y, scale(dot(x, y), x))
        length = norm(y)
    y = scale(1.0 / length, y)
    return from_columns(x, y, cross(x, y))


@kernel
def rotation_cosine(a, b):
    """Cosine of the angle between two rotations, ``(tr(Aᵀ B) - 1) / 2``."""
    trace = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5]
    return 0.5 * (trace + a[6] * b[6] + a[7] * b[7] + a[8] * b[8] - 1.0)


@kernel
def wrap_angle(angle):
    """Map an angle in rad to (-π, π]."""
    return math.atan2(math.sin(angle), math.cos(angle))


@kernel
def clip(value, low, high):
    """Limit a number to [low, high]."""
    return min(max(value, low), high)


def rot6d_from_mat(mats: np.ndarray) -> np.ndarray:
    """First two columns of rotation matrices, stacked.

    Args:
        mats: (..., 3, 3) or (..., 9) row by row.

    Returns:
        (..., 6).
    """
    flat = mats.reshape((*mats.shape[:-2], 9)) if mats.shape[-1] == 3 else mats
    return np.concatenate([flat[..., 0::3], flat[..., 1::3]], axis=-1)


def mat_from_rot6d(rot6d: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of rot6d vectors (..., 6)."""
    flat = rot6d.reshape(-1, 6)
    mats = [orthonormalise(tuple(r[:3]), tuple(r[3:])) for r in flat.astype(float)]
    return np.asarray(mats).reshape((*rot6d.shape[:-1], 3, 3))
