"""Element-wise array mathematics whose result for one row never depends on how many rows there are."""

from __future__ import annotations

import math

import numpy as np

from aerial_il.core.kernels import kernel


def length(vectors: np.ndarray) -> np.ndarray:
    """Euclidean length of vectors (..., 3) -> (...)."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.sqrt(x * x + y * y + z * z)


def planar_length(vectors: np.ndarray) -> np.ndarray:
    """Horizontal length of vectors (..., 2 or 3) -> (...)."""
    x, y = vectors[..., 0], vectors[..., 1]
    return np.sqrt(x * x + y * y)


def rotation_cosine(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cosine of the angle between rotations, ``(tr(Aᵀ B) - 1) / 2``, for matrices (..., 9) -> (...)."""
    total = a[..., 0] * b[..., 0]
    for k in range(1, 9):
        total = total + a[..., k] * b[..., k]
    return 0.5 * (total - 1.0)


def closeness(distance: np.ndarray, scale: float) -> np.ndarray:
    """Smooth reward for a distance: 1 at zero, 1/2 at ``scale``, never negative (a rational bell)."""
    ratio = distance / scale
    return 1.0 / (1.0 + ratio * ratio)


def cosine_and_sine(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cosine and sine of angles (n,), rad, one by one: numpy's own may round differently for one than for many."""
    cosine, sine = np.empty(len(angle)), np.empty(len(angle))
    _write_cosine_and_sine(angle, cosine, sine)
    return cosine, sine


@kernel
def _write_cosine_and_sine(angle, cosine, sine):
    for i in range(angle.size):
        cosine[i], sine[i] = math.cos(angle[i]), math.sin(angle[i])
