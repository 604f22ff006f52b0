"""Linear-quadratic regulation about hover: one matrix from the errors of the state to force and torque.

State, in the heading frame of the vehicle (x forward, z up), all as errors against the reference:

    x = (position 3, velocity 3, roll, pitch, yaw, body rates 3)
    u = (force 3 N, torque 3 N m) about the centre of mass, body axes, beyond those of hover

Linearised about level hover with mass m and inertia J of the vehicle with its arm at rest,

    ṗ = v,   v̇ = g (θ, -φ, 0) + F / m,   (φ, θ, ψ)˙ = ω,   ω̇ = J⁻¹ τ

A vehicle whose rotors all point up has no F in x and y: force comes through the chain torque, rate, tilt, velocity,
position. K minimises ∫ xᵀQx + uᵀRu dt and solves the algebraic Riccati equation (Bouabdallah, Noth & Siegwart, IROS
2004; Bryson & Ho, *Applied Optimal Control*, 1975). Weights follow Bryson's rule, one over the square of the error or
effort that is still acceptable; for a vehicle with slow rotors they are those of the same flight with time stretched by
one over its agility. Hover's own input balances the weight, and the torque of an arm that hangs off centre;
there is no integrator, so that any other steady disturbance leaves a steady error.

The linear law saturates where the linearisation ends: the part of the torque that comes from position and velocity is
shortened so that it asks for no more than the largest tilt.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from aerial_il.control import controller_state as layout
from aerial_il.control.controllers.law import Law
from aerial_il.control.dynamics import put, total_mass, vec
from aerial_il.control.flight import feed_arm_forward, mat
from aerial_il.control.hover import hover_body
from aerial_il.control.vehicle import GRAVITY, Vehicle
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, clip, cross, euler_from_mat, rotate_back, scale, sub, wrap_angle

LARGEST_POSITION, LARGEST_VELOCITY = 0.15, 0.8  # m, m/s, along each axis
LARGEST_TILT, LARGEST_TILT_RATE = 0.5, 3.0  # rad, rad/s
LARGEST_YAW, LARGEST_YAW_RATE = 0.4, 2.0  # rad, rad/s
LARGEST_PUSH, LARGEST_LIFT = 2.0, 4.0  # m/s²: force per mass, sideways and vertical
LARGEST_TILT_ACCELERATION, LARGEST_YAW_ACCELERATION = 50.0, 6.0  # rad/s²: torque per inertia
LEAST_UPRIGHTNESS = 0.5  # cos φ cos θ, below which lift is not made up for


@dataclass(frozen=True)
class LQR(Law):
    """Bouabdallah, Noth & Siegwart (2004), weights by Bryson's rule."""

    summary: ClassVar[str] = "textbook state feedback about hover, trimmed for the arm at rest"

    def numbers(self, vehicle: Vehicle) -> dict[str, Any]:
        return {"feedback": feedback_matrix(vehicle), "com": hover_body(vehicle).com}


def feedback_matrix(vehicle: Vehicle) -> np.ndarray:
    """K (6, 12) of ``u = -K x`` for a vehicle; rows of forces it cannot exert are zero."""
    body, slow = hover_body(vehicle), vehicle.agility
    a, b = hover_model(body.mass, body.inertia)
    errors = np.repeat(
        [LARGEST_POSITION, LARGEST_VELOCITY, LARGEST_TILT, LARGEST_YAW, LARGEST_TILT_RATE, LARGEST_YAW_RATE]
        * slow ** np.array([0, 1, 2, 0, 3, 1]),
        [3, 3, 2, 1, 2, 1],
    )
    pushes = slow**2 * np.repeat([LARGEST_PUSH, LARGEST_LIFT], [2, 1])
    turns = np.repeat([slow**4 * LARGEST_TILT_ACCELERATION, slow**2 * LARGEST_YAW_ACCELERATION], [2, 1])
    efforts = np.concatenate([body.mass * pushes, np.diag(body.inertia) * turns])
    inputs = [k for k in range(6) if k > 1 or vehicle.lateral_limit > 0.0]
    gain = np.zeros((6, 12))
    gain[inputs] = regulator(a, b[:, inputs], np.diag(errors**-2.0), np.diag(efforts[inputs] ** -2.0))
    return gain


def hover_model(mass: float, inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A (12, 12) and B (12, 6) of ``ẋ = A x + B u``; mass in kg, inertia (3, 3) in kg m²."""
    a, b = np.zeros((12, 12)), np.zeros((12, 6))
    a[0:3, 3:6] = a[6:9, 9:12] = np.eye(3)
    a[3, 7], a[4, 6] = GRAVITY, -GRAVITY
    b[3:6, 0:3] = np.eye(3) / mass
    b[9:12, 3:6] = np.linalg.inv(inertia)
    return a, b


def regulator(a: np.ndarray, b: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Gain (M, N) of the linear-quadratic regulator for ``ẋ = A x + B u`` with weights Q (N, N) and R (M, M)."""
    from scipy.linalg import solve_continuous_are

    return np.linalg.solve(r, b.T @ solve_continuous_are(a, b, q, r))


@kernel
def steer(own, vehicle, gains, scratch, state):
    """Feedback of the twelve errors, beyond the input of hover."""
    feed_arm_forward(vehicle, scratch, (0.0, 0.0, 0.0))
    pos, vel, rot = vec(scratch.base_pos, 0), vec(scratch.base_vel, 0), mat(scratch.base_rot)
    roll, pitch, yaw = euler_from_mat(rot)
    c, s = math.cos(yaw), math.sin(yaw)
    heading = (c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
    off = rotate_back(heading, sub(pos, vec(state, layout.BASE_POS)))
    drift = rotate_back(heading, sub(vel, vec(state, layout.BASE_VEL)))
    lean = (roll, pitch, wrap_angle(yaw - state[layout.BASE_YAW]))
    spin = sub(vec(scratch.rate, 0), (0.0, 0.0, state[layout.BASE_YAW_RATE]))
    share = _share_within_tilt(own.feedback, off, drift, gains.max_tilt)
    off, drift = (share * off[0], share * off[1], off[2]), (share * drift[0], share * drift[1], drift[2])
    force = scale(-1.0, _rows(own.feedback, 0, off, drift, lean, spin))
    torque = scale(-1.0, _rows(own.feedback, 3, off, drift, lean, spin))
    mass = total_mass(vehicle)
    most = mass * gains.max_acceleration
    upright = max(math.cos(roll) * math.cos(pitch), LEAST_UPRIGHTNESS)
    force = (force[0], force[1], (mass * GRAVITY + clip(force[2], -most, most)) / upright)
    put(scratch.force, 0, force)
    put(scratch.torque, 0, add(torque, cross(vec(own.com, 0), force)))


@kernel
def _share_within_tilt(feedback, off, drift, max_tilt):
    """Share in (0, 1] of the horizontal errors whose torque a lean of ``max_tilt`` rad just balances."""
    pitch = (feedback[4, 0] * off[0] + feedback[4, 3] * drift[0]) / feedback[4, 7]
    roll = (feedback[3, 1] * off[1] + feedback[3, 4] * drift[1]) / feedback[3, 6]
    return min(1.0, max_tilt / max(math.sqrt(pitch * pitch + roll * roll), 1e-9))


@kernel
def _rows(feedback, first, off, drift, lean, spin):
    """Three rows of the feedback matrix, from row ``first`` on, times the twelve errors."""
    return (
        _row(feedback, first, off, drift, lean, spin),
        _row(feedback, first + 1, off, drift, lean, spin),
        _row(feedback, first + 2, off, drift, lean, spin),
    )


@kernel
def _row(feedback, i, off, drift, lean, spin):
    total = 0.0
    for k in range(3):
        total += feedback[i, k] * off[k] + feedback[i, 3 + k] * drift[k]
        total += feedback[i, 6 + k] * lean[k] + feedback[i, 9 + k] * spin[k]
    return total
