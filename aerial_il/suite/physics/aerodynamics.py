"""Aerodynamics of a vehicle: rotor lag, ground effect, drag against the wind."""

from __future__ import annotations

import math

from aerial_il.control.dynamics import row, vec
from aerial_il.control.vehicle import Vehicle
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, cross, norm, rotate, rotate_back, scale, sub

GROUND_EFFECT = 0.171  # coefficient fitted to flight data (AM-Bench 2026)
AIR_DENSITY = 1.225  # kg/m³
DRAG_AREA = 0.025  # m² of flat plate for a vehicle of 1 kg, growing with mass^(2/3); see docs/tiers.md


def quadratic_drag(vehicle: Vehicle) -> float:
    """Return the drag of a vehicle's body, N s²/m², beside its linear one; an ideal vehicle without any has none."""
    return 0.5 * AIR_DENSITY * DRAG_AREA * vehicle.mass ** (2.0 / 3.0) if vehicle.drag.any() else 0.0


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
def air_wrench(vehicle, quadratic, effects, pos, rot, vel, thrust_now):
    """Drag of the body, extra thrust near the ground, and what disturbances push.

    Drag is linear and quadratic in the velocity relative to the air. The linear part stands for the rotors, whose
    in-plane force grows with airspeed, the quadratic one for the body.

    Args:
        vehicle: geometry. quadratic: drag, N s²/m². effects: of the disturbances, see ``hooks.EFFECTS``.
        pos, rot: base pose. vel: base velocity, world, m/s. thrust_now: (R,) N.

    Returns:
        force (world frame, N) and torque about the base origin (base frame, N m).
    """
    local = rotate_back(rot, sub(vel, vec(effects.wind, 0)))
    body = quadratic * norm(local)
    force = (
        -(vehicle.drag[0] + body) * local[0],
        -(vehicle.drag[1] + body) * local[1],
        -(vehicle.drag[2] + body) * local[2],
    )
    torque = add(vec(effects.torque, 0), cross(vec(effects.lever, 0), force))
    for i in range(vehicle.num_rotors):
        where = row(vehicle.rotor_pos, i)
        height = pos[2] + rotate(rot, where)[2]
        gain = ground_effect(height, vehicle.rotor_radius) - 1.0
        push = scale(gain * thrust_now[i], row(vehicle.rotor_axis, i))
        force = add(force, push)
        torque = add(torque, add(cross(where, push), scale(vehicle.rotor_drag_ratio[i], push)))
    return add(rotate(rot, force), vec(effects.force, 0)), torque
