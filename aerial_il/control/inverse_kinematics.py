"""Differential inverse kinematics of the whole body, damped, weighted, within joint limits.

One step solves ``min |W (J δ - e)|² + λ² |S⁻¹ (δ - δ0)|²`` (damped least squares, Nakamura & Hanafusa 1986; Wampler
1986): δ0 pulls the redundant coordinates to a rest posture, S makes coordinates cheap or dear, and a coordinate at its
limit is taken out of the solution.
"""

from __future__ import annotations

import math

import numpy as np

from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip


@kernel
def damped_least_squares(jacobian, error, row_weight, column_scale, rest_pull, damping, step):
    """Solve one damped, weighted step.

    Args:
        jacobian: (6, V) task Jacobian.
        error: (6,) task error, m and rad.
        row_weight: (6,) weight of each task row.
        column_scale: (V,) mobility of each coordinate; 0 freezes it.
        rest_pull: (V,) displacement wanted in the null space.
        damping: λ, in the unit of the weighted rows.
        step: (V,) written: displacement of the coordinates.
    """
    size = step.size
    work = np.empty((13, max(6, size)))  # one allocation: this runs 500 times per simulated second and world
    scaled, gram, y = work[:6], work[6:12], work[12, :6]
    for r in range(6):
        residual = error[r]
        for c in range(size):
            scaled[r, c] = row_weight[r] * jacobian[r, c] * column_scale[c]
            if column_scale[c] > 0.0:
                residual -= jacobian[r, c] * rest_pull[c]
        y[r] = row_weight[r] * residual
    for r in range(6):
        for s in range(r + 1):
            total = damping * damping if r == s else 0.0
            for c in range(size):
                total += scaled[r, c] * scaled[s, c]
            gram[r, s] = total
    _solve_cholesky(gram, y)
    for c in range(size):
        step[c] = 0.0
        if column_scale[c] > 0.0:
            total = 0.0
            for r in range(6):
                total += scaled[r, c] * y[r]
            step[c] = rest_pull[c] + column_scale[c] * total


@kernel
def _solve_cholesky(a, b):
    """Solve A x = b in place for symmetric positive definite A (lower triangle given, overwritten); x in b."""
    size = b.size
    for i in range(size):
        for j in range(i + 1):
            total = a[i, j]
            for k in range(j):
                total -= a[i, k] * a[j, k]
            a[i, j] = math.sqrt(total) if i == j else total / a[j, j]
    for i in range(size):
        for k in range(i):
            b[i] -= a[i, k] * b[k]
        b[i] /= a[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            b[i] -= a[k, i] * b[k]
        b[i] /= a[i, i]


@kernel
def freeze_at_limits(joints, low, high, step, column_scale, first):
    """Freeze the joints that the last step drives out of their limits.

    Args:
        joints, low, high: (J,) rad.
        step: (V,) last solution; column_scale: (V,) changed in place.
        first: index of the first joint among the V coordinates.

    Returns:
        Whether any joint was frozen, so that the step must be solved again.
    """
    frozen = False
    for j in range(joints.size):
        wanted = joints[j] + step[first + j]
        if column_scale[first + j] > 0.0 and (wanted < low[j] or wanted > high[j]):
            column_scale[first + j] = 0.0
            step[first + j] = clip(wanted, low[j], high[j]) - joints[j]
            frozen = True
    return frozen


@kernel
def rest_posture(vehicle, pitch, posture):
    """Rest posture for a tool pitched ``pitch`` rad below the horizon.

    Blends the two rest postures by pitch; the last joint takes what remains, so that the tool's pitch is exact.

    Args:
        vehicle: the nominal model. pitch: rad, 0 = horizontal, π/2 = straight down.
        posture: (J,) written, rad.
    """
    blend = clip(pitch / (0.5 * math.pi), 0.0, 1.0)
    last = posture.size - 1
    remaining = pitch
    for j in range(last + 1):
        posture[j] = (1.0 - blend) * vehicle.rest_forward[j] + blend * vehicle.rest_down[j]
        if j < last and vehicle.link_axis[j, 1] > 0.5:
            remaining -= posture[j]
    posture[last] = clip(remaining, vehicle.joint_low[last], vehicle.joint_high[last])
