"""Aerodynamics of a vehicle: rotors and their lag, ground effect, drag against the wind."""

from __future__ import annotations

import math

from aerial_il.control.dynamics import row, vec
from aerial_il.control.vehicle import Vehicle
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, cross, norm, rotate, rotate_back, scale, sub
from aerial_il.suite.physics.native import row_at

GROUND_EFFECT = 0.171  # coefficient fitted to flight data (AM-Bench 2026)
AIR_DENSITY = 1.225  # kg/m³
DRAG_AREA = 0.025  # m² of flat plate for a vehicle of 1 kg, growing with mass^(2/3); see docs/tiers.md


def quadratic_drag(vehicle: Vehicle) -> float:
    """Return the drag of a vehicle's body, N s²/m², beside its linear one; an ideal vehicle without any has none."""
    return 0.5 * AIR_DENSITY * DRAG_AREA * vehicle.mass ** (2.0 / 3.0) if vehicle.drag.any() else 0.0


@kernel
def lag_share(tau, dt):
    """Share of the way to its input that a first-order lag of ``tau`` goes in ``dt``; both in s."""
    return 1.0 - math.exp(-dt / tau)


@kernel
def lagged_command(command, thrust_now, share):
    """Shift a thrust command so that a first-order lag of ``tau_up`` acts as one of ``tau_down`` when thrust falls.

    ``share``: ratio of what the two lags go in a step, see :func:`lag_share`; the rest in N.
    """
    if command >= thrust_now:
        return command
    return thrust_now + share * (command - thrust_now)


@kernel
def follow(vehicle, command, share, thrust):
    """Let the thrusts go the ``share`` of the way to their commands (R,), which are held within limits; all in N."""
    for i in range(thrust.size):
        reachable = min(max(command[i], vehicle.rotor_min[i]), vehicle.rotor_max[i])
        thrust[i] += share * (reachable - thrust[i])


@kernel
def thrust_wrench(rotors, gain, thrust, rot):
    """Push of the rotors.

    Args:
        rotors: (R, 6) force and torque of each per newton, base frame. gain: (R,) what each gives of its thrust.
        thrust: (R,) N. rot: world from base.

    Returns:
        force (world frame, N) and torque about the base origin (base frame, N m).
    """
    force, torque = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(thrust.size):
        wrench, push = row_at(rotors, i), gain[i] * thrust[i]
        force, torque = add(force, scale(push, vec(wrench, 0))), add(torque, scale(push, vec(wrench, 3)))
    return rotate(rot, force), torque


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
