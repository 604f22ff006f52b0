"""Differential inverse kinematics of the whole body, damped, weighted, within joint limits.

One step solves ``min |W (J δ - e)|² + λ² |S⁻¹ (δ - δ0)|²`` (damped least squares, Nakamura & Hanafusa 1986; Wampler
1986): δ0 pulls the redundant coordinates to a rest posture, S makes coordinates cheap or dear, and a coordinate at its
limit is taken out of the solution. The whole body has more coordinates than the task has rows and is solved in task
space, ``δ = δ0 + S A' (A A' + λ² 1)⁻¹ W (e - J δ0)`` with ``A = W J S``; an arm alone has at most as many and is
solved in joint space, ``(A' A + λ² 1) S⁻¹ (δ - δ0) = A' W (e - J δ0)``: the same minimum.
"""

import math

from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip


@kernel
def solve_in_task_space(scratch, count, damping):
    """Solve one step of the first ``count`` coordinates.

    Args:
        scratch: working memory, with
            ``jacobian``: (6, V) task Jacobian; ``error``: (6,) task error, m and rad;
            ``weight``: (6,) weight of each task row;
            ``mobility``: (V,) of each coordinate, 0 freezes it; ``pull``: (V,) displacement wanted in the null space;
            ``step``: (V,) written: displacement of the coordinates.
        count: V. damping: λ, in the unit of the weighted rows.
    """
    scaled, gram, y, mobility = scratch.scaled, scratch.gram, scratch.residual, scratch.mobility
    _scale(scratch, 0, count)
    for r in range(6):
        for s in range(r + 1):
            total = damping * damping if r == s else 0.0
            for c in range(count):
                total += scaled[r, c] * scaled[s, c]
            gram[r, s] = total
    solve_cholesky(gram, y, 6)
    for c in range(count):
        total = 0.0
        for r in range(6):
            total += scaled[r, c] * y[r]
        scratch.step[c] = scratch.pull[c] + mobility[c] * total if mobility[c] > 0.0 else 0.0


@kernel
def solve_in_joint_space(scratch, first, count, damping):
    """Solve one step of ``count`` coordinates from ``first`` on; arguments as of :func:`solve_in_task_space`."""
    scaled, gram, mobility = scratch.scaled, scratch.gram, scratch.mobility
    _scale(scratch, first, first + count)
    for a in range(count):
        for b in range(a + 1):
            total = damping * damping if a == b else 0.0
            for r in range(6):
                total += scaled[r, first + a] * scaled[r, first + b]
            gram[a, b] = total
    for a in range(count):
        total = 0.0
        for r in range(6):
            total += scaled[r, first + a] * scratch.residual[r]
        scratch.solution[a] = total
    solve_cholesky(gram, scratch.solution, count)
    for a in range(count):
        c = first + a
        scratch.step[c] = scratch.pull[c] + mobility[c] * scratch.solution[a] if mobility[c] > 0.0 else 0.0


@kernel
def _scale(scratch, first, stop):
    """Write ``A = W J S`` and the residual ``W (e - J δ0)`` for the coordinates ``first`` to ``stop - 1``."""
    jacobian, weight, mobility, pull = scratch.jacobian, scratch.weight, scratch.mobility, scratch.pull
    for r in range(6):
        residual = scratch.error[r]
        for c in range(first, stop):
            scratch.scaled[r, c] = weight[r] * jacobian[r, c] * mobility[c]
            if mobility[c] > 0.0:
                residual -= jacobian[r, c] * pull[c]
        scratch.residual[r] = weight[r] * residual


@kernel
def solve_cholesky(a, b, size):
    """Solve A x = b in place for symmetric positive definite A (lower triangle given, overwritten); x in b."""
    for i in range(size):
        for j in range(i + 1):
            total = a[i, j]
            for k in range(j):
                total -= a[i, k] * a[j, k]
            a[i, j] = 1.0 / math.sqrt(total) if i == j else total * a[j, j]  # the diagonal is kept inverted
    for i in range(size):
        for k in range(i):
            b[i] -= a[i, k] * b[k]
        b[i] *= a[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            b[i] -= a[k, i] * b[k]
        b[i] *= a[i, i]


@kernel
def freeze_at_limits(vehicle, scratch, joints, start):
    """Freeze the joints that the last step drives out of their limits.

    Args:
        vehicle: the nominal model. scratch: working memory with the last ``step``; ``mobility`` is changed.
        joints: joint positions, rad, from index ``start`` on.

    Returns:
        Whether any joint was frozen, so that the step must be solved again.
    """
    frozen = False
    for j in range(vehicle.num_joints):
        wanted = joints[start + j] + scratch.step[4 + j]
        outside = wanted < vehicle.joint_low[j] or wanted > vehicle.joint_high[j]
        if outside and scratch.mobility[4 + j] > 0.0:
            scratch.mobility[4 + j] = 0.0
            frozen = True
    return frozen


@kernel
def rest_posture(vehicle, pitch, posture, start):
    """Rest posture for a tool pitched ``pitch`` rad below the horizon.

    Blends the two rest postures by pitch; the wrist, the last joint that pitches, takes what remains, so that the
    tool's pitch is exact.

    Args:
        vehicle: the nominal model. pitch: rad, 0 = horizontal, π/2 = straight down.
        posture: written, rad, from index ``start`` on.
    """
    blend = clip(pitch / (0.5 * math.pi), 0.0, 1.0)
    wrist, missing = -1, pitch
    for j in range(vehicle.num_joints):
        posture[start + j] = (1.0 - blend) * vehicle.rest_forward[j] + blend * vehicle.rest_down[j]
        if abs(vehicle.link_axis[j, 1]) > 0.5:
            wrist = j
            missing -= vehicle.link_axis[j, 1] * posture[start + j]
    if wrist >= 0:
        wanted = posture[start + wrist] + vehicle.link_axis[wrist, 1] * missing
        posture[start + wrist] = clip(wanted, vehicle.joint_low[wrist], vehicle.joint_high[wrist])
