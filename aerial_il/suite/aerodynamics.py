"""What the air does: rotor lag, ground effect, body drag, gusts."""

from __future__ import annotations

import math
from typing import NamedTuple

from aerial_il.control.dynamics import vec
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, clip, cross, rotate, rotate_back, scale
from aerial_il.suite.noise import gaussian

GROUND_EFFECT = 0.171  # coefficient fitted to flight data (AM-Bench 2026)
GUST_RISE_S = 0.15  # low-pass of the gust's onset on the airframe


class Air(NamedTuple):
    """Strength of the disturbances on one vehicle.

    Attributes:
        gust_force, gust_limit: standard deviation and bound along each axis, N.
        gust_torque, gust_torque_limit: the same for the torque, N m.
        gust_time: correlation time, s.
    """

    gust_force: float
    gust_limit: float
    gust_torque: float
    gust_torque_limit: float
    gust_time: float


@kernel
def lagged_command(command, thrust_now, tau_up, tau_down, dt):
    """Shift a thrust command so that a first-order lag of ``tau_up`` acts as one of ``tau_down`` when thrust falls.

    The actuator integrates ``act' = (ctrl - act) / tau_up`` exactly; this returns the ctrl for which one step gives
    what ``tau_down`` would have given. N and s.
    """
    if command >= thrust_now:
        return command
    ratio = (1.0 - math.exp(-dt / tau_down)) / (1.0 - math.exp(-dt / tau_up))
    return thrust_now + ratio * (command - thrust_now)


@kernel
def ground_effect(height, radius):
    """Thrust gain of a rotor ``height`` m above the ground: 1 / (1 - c (R/4z)²) (Cheeseman & Bennett 1955)."""
    ratio = radius / (4.0 * max(height, 0.5 * radius))
    return 1.0 / (1.0 - GROUND_EFFECT * ratio * ratio)


@kernel
def air_wrench(vehicle, pos, rot, vel, thrust_now):
    """Drag of the body and extra thrust near the ground.

    Args:
        vehicle: geometry. pos, rot: base pose. vel: base velocity, world, m/s. thrust_now: (R,) N.

    Returns:
        force (N) and torque about the base origin (N m), world frame.
    """
    local = rotate_back(rot, vel)
    drag = (-vehicle.drag[0] * local[0], -vehicle.drag[1] * local[1], -vehicle.drag[2] * local[2])
    force, torque = drag, (0.0, 0.0, 0.0)
    for i in range(thrust_now.size):
        where = vec(vehicle.rotor_pos[i], 0)
        height = pos[2] + rotate(rot, where)[2]
        gain = ground_effect(height, vehicle.rotor_radius) - 1.0
        push = scale(gain * thrust_now[i], vec(vehicle.rotor_axis[i], 0))
        force = add(force, push)
        torque = add(torque, add(cross(where, push), scale(vehicle.rotor_drag_ratio[i], push)))
    return rotate(rot, force), rotate(rot, torque)


@kernel
def advance_gusts(air, gust, seed, tick, dt):
    """Advance the gusts by ``dt`` seconds.

    A Gauss–Markov process per axis, the longitudinal Dryden form (MIL-F-8785C), smoothed by the airframe's rise time.

    Args:
        air: strengths. gust: (12,) filter states (6) and outputs (6): force, torque, world frame, in units of one
            standard deviation; changed in place. seed: episode seed. tick: physics steps since the start.
    """
    decay = math.exp(-dt / air.gust_time)
    kick = math.sqrt(1.0 - decay * decay)
    rise = 1.0 - math.exp(-dt / GUST_RISE_S)
    for k in range(6):
        gust[k] = decay * gust[k] + kick * gaussian(seed, tick, k)
        gust[6 + k] += rise * (gust[k] - gust[6 + k])


@kernel
def gust_wrench(air, gust):
    """Force (N) and torque (N m) of the present gust, world frame."""
    f, fmax, t, tmax = air.gust_force, air.gust_limit, air.gust_torque, air.gust_torque_limit
    force = (clip(f * gust[6], -fmax, fmax), clip(f * gust[7], -fmax, fmax), clip(f * gust[8], -fmax, fmax))
    torque = (clip(t * gust[9], -tmax, tmax), clip(t * gust[10], -tmax, tmax), clip(t * gust[11], -tmax, tmax))
    return force, torque
