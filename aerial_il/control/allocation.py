"""From a body wrench to rotor thrusts, and what to give up when the rotors cannot deliver it.

The wrench of R rotors with thrusts f is ``B f`` with columns ``[n; p × n + κ n]`` (position p, axis n, drag-torque
ratio κ). The mixer is the pseudo-inverse of the rows a vehicle can actuate. What it demands is given if it lies within
the limits. Under saturation thrust along z with roll and pitch torque come first, then sideways force, then yaw, as in
PX4's prioritised mixer.
"""

import math

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.kernels import kernel

FORCE_Z_AND_TORQUES = (2, 3, 4, 5)
FULL_WRENCH = (0, 1, 2, 3, 4, 5)


def wrench_matrix(rotor_pos: np.ndarray, rotor_axis: np.ndarray, rotor_drag_ratio: np.ndarray) -> np.ndarray:
    """Body wrench per unit rotor thrust.

    Args:
        rotor_pos: (R, 3) m, rotor_axis: (R, 3) unit, rotor_drag_ratio: (R,) signed, m; all in the base frame.

    Returns:
        (6, R): rows force x, y, z and torque x, y, z about the base origin.
    """
    torque = np.cross(rotor_pos, rotor_axis) + rotor_drag_ratio[:, None] * rotor_axis
    return np.concatenate([rotor_axis, torque], axis=1).T


def mixer_matrix(wrench_from_thrust: np.ndarray) -> np.ndarray:
    """Pseudo-inverse of the actuated rows; the columns of rows that cannot be actuated are zero.

    Args:
        wrench_from_thrust: (6, R).

    Returns:
        (R, 6) thrusts per unit wrench.

    Raises:
        InvalidValueError: the rotors cannot produce lift and all three torques independently.
    """
    rank = np.linalg.matrix_rank(wrench_from_thrust, tol=1e-6)
    rows = list(FULL_WRENCH if rank == 6 else FORCE_Z_AND_TORQUES)
    actuated = wrench_from_thrust[rows]
    if np.linalg.matrix_rank(actuated, tol=1e-6) < len(rows):
        raise InvalidValueError(
            f"{wrench_from_thrust.shape[1]} rotors of rank {rank} cannot produce lift and three torques independently; "
            "check rotor positions and the signs of the drag-torque ratios."
        )
    mixer = np.zeros((wrench_from_thrust.shape[1], 6))
    mixer[:, rows] = np.linalg.pinv(actuated)
    return mixer


@kernel
def allocate(mixer, rotor_min, rotor_max, force, torque, thrust):
    """Distribute a body wrench over the rotors, within their limits.

    Args:
        mixer: (R, 6). rotor_min, rotor_max: (R,) N.
        force: body-frame force, N. torque: body-frame torque about the base origin, N m.
        thrust: (R,) written: thrust of every rotor in [rotor_min, rotor_max], N.
    """
    if _meets_demand(mixer, rotor_min, rotor_max, force, torque, thrust):
        return
    lift = _make_headroom(mixer, force[2], torque, rotor_min, rotor_max)
    for i in range(thrust.size):
        thrust[i] = min(max(mixer[i, 2] * lift, rotor_min[i]), rotor_max[i])
    _add_within_limits(mixer, 3, torque[0], torque[1], thrust, rotor_min, rotor_max)
    _add_within_limits(mixer, 0, force[0], force[1], thrust, rotor_min, rotor_max)
    _add_within_limits(mixer, 5, torque[2], 0.0, thrust, rotor_min, rotor_max)


@kernel
def _meets_demand(mixer, low, high, force, torque, thrust):
    """Write the thrusts of the whole wrench; return whether all lie within their limits."""
    fits = True
    for i in range(thrust.size):
        tilt = _demand(mixer, i, 3, torque[0], torque[1])
        sideways = _demand(mixer, i, 0, force[0], force[1])
        thrust[i] = mixer[i, 2] * force[2] + tilt + sideways + _demand(mixer, i, 5, torque[2], 0.0)
        fits = fits and low[i] <= thrust[i] <= high[i]
    return fits


@kernel
def _demand(mixer, i, row, first, second):
    """Thrust that rotor ``i`` adds for the wrench rows ``row`` and ``row + 1`` (yaw, the last row, stands alone)."""
    if row == 5:
        return mixer[i, 5] * first
    return mixer[i, row] * first + mixer[i, row + 1] * second


@kernel
def _add_within_limits(mixer, row, first, second, thrust, low, high):
    """Add as much of two wrench components as fits: the largest share s in [0, 1] for all rotors alike."""
    s = 1.0
    for i in range(thrust.size):
        extra = _demand(mixer, i, row, first, second)
        if extra > 1e-12:
            s = min(s, max(0.0, (high[i] - thrust[i]) / extra))
        elif extra < -1e-12:
            s = min(s, max(0.0, (thrust[i] - low[i]) / -extra))
    for i in range(thrust.size):
        wanted = thrust[i] + s * _demand(mixer, i, row, first, second)
        thrust[i] = min(max(wanted, low[i]), high[i])


@kernel
def _make_headroom(mixer, lift, torque, low, high):
    """Return the force along z nearest to ``lift`` (N) that leaves room for the tilting torque: attitude first."""
    least, most = -math.inf, math.inf
    for i in range(mixer.shape[0]):
        if mixer[i, 2] > 1e-9:  # others add nothing to the lift and cannot be helped by it
            tilt = _demand(mixer, i, 3, torque[0], torque[1])
            least = max(least, (low[i] - tilt) / mixer[i, 2])
            most = min(most, (high[i] - tilt) / mixer[i, 2])
    if least > most:
        return 0.5 * (least + most)
    return min(max(lift, least), most)
