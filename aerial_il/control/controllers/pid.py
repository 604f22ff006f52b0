"""The textbook cascade: a PID loop for position makes a thrust and a tilt, a PID loop for attitude makes the torque.

With e = reference - actual, in this order:

    a   = a_ref + kp e + kv ė + ki ∫e            commanded acceleration, world
    θ_d =  ( aₓ cos ψ + a_y sin ψ) / g           pitch and roll that point the thrust there, small angles
    φ_d = -(-aₓ sin ψ + a_y cos ψ) / g
    f_z = m (g + a_z) / (cos φ cos θ)            hover thrust fed forward, corrected for the tilt
    τ   = J (kR e_φθψ - kΩ ω + kI ∫e_φθψ)        J: diagonal inertia of the hovering vehicle

Mahony, Kumar & Corke, "Multirotor Aerial Vehicles" (IEEE Robotics & Automation Magazine 2012, eq. 16 to 20) for the
cascade; Bouabdallah, Noth & Siegwart, "PID vs LQ control techniques applied to an indoor micro quadrotor" (IROS 2004)
for the attitude. The law knows neither the arm's posture nor its motion: what the arm does to the base is left to the
integrators. Three things keep them from winding up: they stand still far from the reference and while the command that
they add to is saturated in their direction (conditional integration), and they are bounded.

A vehicle with tilted rotors exerts as much of the sideways force as it can and tilts only for the rest.
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
from aerial_il.core.rotations import (
    add,
    clip,
    dot,
    euler_from_mat,
    limit_norm,
    norm,
    rotate_back,
    scale,
    sub,
    wrap_angle,
)

NEAR, NEAR_ANGLE = 0.2, 0.15  # m, rad: an integrator stands still farther from its reference
POSITION_INTEGRAL, ATTITUDE_INTEGRAL = layout.LAW, layout.LAW + 3  # added so far, m/s² (world) and rad/s²
LARGEST_POSITION_INTEGRAL = 3.0  # m/s²
LARGEST_ATTITUDE_INTEGRAL = 30.0  # rad/s², on each axis
LARGEST_TILT_ACCELERATION, LARGEST_YAW_ACCELERATION = 60.0, 20.0  # rad/s²
LEAST_UPRIGHTNESS = 0.5  # cos φ cos θ, below which lift is not made up for


@dataclass(frozen=True)
class PID(Law):
    """Mahony, Kumar & Corke (2012), with integrators that do not wind up."""

    summary: ClassVar[str] = "textbook cascade: PID for position and attitude, hover thrust fed forward"

    def numbers(self, vehicle: Vehicle) -> dict[str, Any]:
        return {"inertia": np.diag(hover_body(vehicle).inertia)}


@kernel
def steer(own, vehicle, gains, scratch, state):
    """The cascade; integrals in the state are advanced."""
    feed_arm_forward(vehicle, scratch, (0.0, 0.0, 0.0))
    pos, vel, rot = vec(scratch.base_pos, 0), vec(scratch.base_vel, 0), mat(scratch.base_rot)
    dt = scratch.dt
    acc = _position_loop(gains, state, pos, vel, vec(scratch.feed_forward, 0), dt)
    mass = total_mass(vehicle)
    roll, pitch, yaw = euler_from_mat(rot)
    c, s = math.cos(yaw), math.sin(yaw)
    sideways = mass * math.sqrt(acc[0] * acc[0] + acc[1] * acc[1])
    by_tilt = max(0.0, sideways - vehicle.lateral_limit) / max(sideways, 1e-9) / GRAVITY
    forward, left = by_tilt * (c * acc[0] + s * acc[1]), by_tilt * (-s * acc[0] + c * acc[1])
    tilt = limit_norm((-left, forward, 0.0), gains.max_tilt)
    error = (tilt[0] - roll, tilt[1] - pitch, wrap_angle(state[layout.BASE_YAW] - yaw))
    rate_error = sub((0.0, 0.0, state[layout.BASE_YAW_RATE]), vec(scratch.rate, 0))
    alpha = _attitude_loop(gains, state, error, rate_error, dt)
    push = rotate_back(rot, scale(mass, add(acc, (0.0, 0.0, GRAVITY))))
    lift = mass * (GRAVITY + acc[2]) / max(math.cos(roll) * math.cos(pitch), LEAST_UPRIGHTNESS)
    put(scratch.force, 0, (push[0], push[1], lift))
    for k in range(3):
        scratch.torque[k] = own.inertia[k] * alpha[k]


@kernel
def _position_loop(gains, state, pos, vel, feed_forward, dt):
    """Commanded acceleration of the base, world, m/s²."""
    error = sub(vec(state, layout.BASE_POS), pos)
    error_rate = sub(vec(state, layout.BASE_VEL), vel)
    integral = vec(state, POSITION_INTEGRAL)
    wanted = add(feed_forward, add(scale(gains.position, error), scale(gains.velocity, error_rate)))
    wanted = add(wanted, integral)
    if norm(error) < NEAR and (norm(wanted) <= gains.max_acceleration or dot(wanted, error) < 0.0):
        integral = limit_norm(add(integral, scale(gains.integral * dt, error)), LARGEST_POSITION_INTEGRAL)
        put(state, POSITION_INTEGRAL, integral)
    return limit_norm(wanted, gains.max_acceleration)


@kernel
def _attitude_loop(gains, state, error, rate_error, dt):
    """Commanded angular acceleration about roll, pitch and yaw, rad/s²; ``error`` in rad, ``rate_error`` in rad/s."""
    pid, limit = (gains.attitude, gains.attitude_integral, gains.rate), LARGEST_TILT_ACCELERATION
    roll = _axis(state, ATTITUDE_INTEGRAL, error[0], rate_error[0], pid, limit, dt)
    pitch = _axis(state, ATTITUDE_INTEGRAL + 1, error[1], rate_error[1], pid, limit, dt)
    pid, limit = (gains.heading, gains.heading_integral, gains.heading_rate), LARGEST_YAW_ACCELERATION
    return (roll, pitch, _axis(state, ATTITUDE_INTEGRAL + 2, error[2], rate_error[2], pid, limit, dt))


@kernel
def _axis(state, place, error, rate_error, pid, limit, dt):
    """One axis of the attitude: proportional, integral and differential gain, the integral at ``place`` of state."""
    wanted = pid[0] * error + state[place] + pid[2] * rate_error
    if abs(error) < NEAR_ANGLE and (abs(wanted) <= limit or wanted * error < 0.0):
        grown = state[place] + pid[1] * dt * error
        state[place] = clip(grown, -LARGEST_ATTITUDE_INTEGRAL, LARGEST_ATTITUDE_INTEGRAL)
    return clip(wanted, -limit, limit)
