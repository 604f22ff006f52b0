"""State estimate that the flight controller flies on in place of the truth, with slowly wandering errors.

The controller flies on the estimate, as on a vehicle that is tracked by cameras or by visual-inertial odometry. Rewards
and success stay true; observations show the estimate where :mod:`aerial_il.suite.episode.estimation` is at work. Joint
encoders and rotor speeds are taken as exact.
"""

from __future__ import annotations

import math

from aerial_il.control.dynamics import put, vec
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, scale


@kernel
def vehicle_state(vehicle, qpos, qvel, pos, vel):
    """Pick the vehicle's own true state out of a scene's; a fixed base, which has no joint, stands where it stands.

    Args:
        vehicle: its record. qpos, qvel: of the scene, the vehicle's joints first.
        pos: (7 + J,) written: base position, quaternion, joints. vel: (6 + J,) written: twist, joint velocities.
    """
    free = vehicle.base_mobility > 0.0
    for k in range(7):
        pos[k] = qpos[k] if free else vehicle.base_pose[k]
    for k in range(6):
        vel[k] = qvel[k] if free else 0.0
    first_pos, first_vel = (7, 6) if free else (0, 0)
    for j in range(vehicle.num_joints):
        pos[7 + j], vel[6 + j] = qpos[first_pos + j], qvel[first_vel + j]


@kernel
def measure(vehicle, effects, pos, vel, measured_pos, measured_vel):
    """Estimate of the vehicle's state; where a fixed base stands is known.

    Args:
        vehicle: its record. effects: of the disturbances, see ``hooks.EFFECTS``; errors of the estimate among them.
        pos, vel: true state, see :func:`vehicle_state`.
        measured_pos: (7 + J,) written. measured_vel: (6 + J,) written.
    """
    unsure = vehicle.base_mobility
    for j in range(vehicle.num_joints):
        measured_pos[7 + j], measured_vel[6 + j] = pos[7 + j], vel[6 + j]
    put(measured_pos, 0, add(vec(pos, 0), scale(unsure, vec(effects.position, 0))))
    put(measured_vel, 0, add(vec(vel, 0), scale(unsure, vec(effects.velocity, 0))))
    put(measured_vel, 3, add(vec(vel, 3), scale(unsure, vec(effects.rate, 0))))
    x, y, z = scale(0.5 * unsure, vec(effects.attitude, 0))
    w, qx, qy, qz = pos[3], pos[4], pos[5], pos[6]  # times the small rotation (1, x, y, z), then normalised
    turned = (
        w - x * qx - y * qy - z * qz,
        qx + w * x + qy * z - qz * y,
        qy + w * y + qz * x - qx * z,
        qz + w * z + qx * y - qy * x,
    )
    length = math.sqrt(turned[0] ** 2 + turned[1] ** 2 + turned[2] ** 2 + turned[3] ** 2)
    for k in range(4):
        measured_pos[3 + k] = turned[k] / length
