"""Array mathematics whose result for one row never depends on how many rows there are.

What is called several times per step is compiled: a dozen small array operations on strided columns cost more than the
numbers in them.
"""

import math

import numpy as np

from aerial_il.core.kernels import kernel


def length(vectors: np.ndarray) -> np.ndarray:
    """Euclidean length of vectors (..., 3) -> (...)."""
    out = np.empty(vectors.shape[:-1])
    _write_lengths(vectors.reshape(-1, vectors.shape[-1]), out.reshape(-1))
    return out[()]


def planar_length(vectors: np.ndarray) -> np.ndarray:
    """Horizontal length of vectors (..., 2 or 3) -> (...)."""
    out = np.empty(vectors.shape[:-1])
    _write_planar_lengths(vectors.reshape(-1, vectors.shape[-1]), out.reshape(-1))
    return out[()]


def rotation_cosine(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cosine of the angle between rotations, ``(tr(Aᵀ B) - 1) / 2``, for matrices (n, 9) -> (n,)."""
    out = np.empty(len(a))
    _write_rotation_cosines(a, b, out)
    return out


@kernel
def _write_lengths(vectors, out):
    for i in range(out.size):
        x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        out[i] = math.sqrt(x * x + y * y + z * z)


@kernel
def _write_planar_lengths(vectors, out):
    for i in range(out.size):
        x, y = vectors[i, 0], vectors[i, 1]
        out[i] = math.sqrt(x * x + y * y)


@kernel
def _write_rotation_cosines(a, b, out):
    for i in range(out.size):
        total = a[i, 0] * b[i, 0]
        for k in range(1, 9):
            total += a[i, k] * b[i, k]
        out[i] = 0.5 * (total - 1.0)
