"""Aerodynamics of a vehicle: rotor lag, ground effect, drag against the wind."""

from __future__ import annotations

import math

from aerial_il.control.dynamics import row, vec
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, cross, norm, rotate, rotate_back, scale, sub
from aerial_il.suite.physics.wind import VELOCITY, centre_of_pressure

GROUND_EFFECT = 0.171  # coefficient fitted to flight data (AM-Bench 2026)


@kernel
def falling_share(tau_up, tau_down, dt):
    """Ratio of the steps that first-order lags of ``tau_down`` and ``tau_up`` take; all in s."""
    return (1.0 - math.exp(-dt / tau_down)) / (1.0 - math.exp(-dt / tau_up))


@kernel
def lagged_command(command, thrust_now, share):
    """Shift a thrust command so that a first-order lag of ``tau_up`` acts as one of ``tau_down`` when thrust falls.

    The actuator integrates ``act' = (ctrl - act) / tau_up`` exactly; this returns the ctrl for which one step gives
    what ``tau_down`` would have given. ``share``: see :func:`falling_share`; the rest in N.
    """
    if command >= thrust_now:
        return command
    return thrust_now + share * (command - thrust_now)


@kernel
def ground_effect(height, radius):
    """Thrust gain of a rotor ``height`` m above the ground: 1 / (1 - c (R/4z)²) (Cheeseman & Bennett 1955)."""
    ratio = radius / (4.0 * max(height, 0.5 * radius, 1e-3))
    return 1.0 / (1.0 - GROUND_EFFECT * ratio * ratio)


@kernel
def air_wrench(vehicle, air, wind, pos, rot, vel, thrust_now):
    """Drag of the body and extra thrust near the ground.

    Drag is linear and quadratic in the velocity relative to the air. The linear part stands for the rotors, whose
    in-plane force grows with airspeed, the quadratic one for the body.

    Args:
        vehicle: geometry. air: what surrounds it. wind: (WIND_SIZE,) state of the wind, zero in still air.
        pos, rot: base pose. vel: base velocity, world, m/s. thrust_now: (R,) N.

    Returns:
        force (world frame, N) and torque about the base origin (base frame, N m).
    """
    local = rotate_back(rot, sub(vel, vec(wind, VELOCITY)))
    body = air.quadratic_drag * norm(local)
    force = (
        -(vehicle.drag[0] + body) * local[0],
        -(vehicle.drag[1] + body) * local[1],
        -(vehicle.drag[2] + body) * local[2],
    )
    torque = (0.0, 0.0, 0.0)
    if air.speed > 0.0:
        torque = cross(centre_of_pressure(air, wind), force)
    for i in range(vehicle.num_rotors):
        where = row(vehicle.rotor_pos, i)
        height = pos[2] + rotate(rot, where)[2]
        gain = ground_effect(height, vehicle.rotor_radius) - 1.0
        push = scale(gain * thrust_now[i], row(vehicle.rotor_axis, i))
        force = add(force, push)
        torque = add(torque, add(cross(where, push), scale(vehicle.rotor_drag_ratio[i], push)))
    return rotate(rot, force), torque
