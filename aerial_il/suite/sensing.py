"""What the flight controller measures instead of the truth: a state estimate with slowly wandering errors.

Observations, rewards and success stay true; only the controller flies on the estimate, as on a vehicle that is tracked
by cameras or by visual-inertial odometry. Joint encoders and rotor speeds are taken as exact.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from aerial_il.control.dynamics import put, vec
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, scale
from aerial_il.suite.noise import gaussian

FIRST_CHANNEL = 16  # of the random numbers; gusts use those below


class Sensors(NamedTuple):
    """Standard deviations of the estimate's errors along each axis, and how long they persist.

    Attributes:
        position: m. velocity: m/s. attitude: rad. rate: rad/s, body frame. time: correlation time, s.
    """

    position: float = 0.002
    velocity: float = 0.01
    attitude: float = 0.003
    rate: float = 0.01
    time: float = 0.1


@kernel
def advance_noise(sensors, noise, seed, tick, dt):
    """Advance the twelve errors (12,), each a Gauss–Markov process of unit variance, by ``dt`` s."""
    decay = math.exp(-dt / sensors.time)
    kick = math.sqrt(1.0 - decay * decay)
    for k in range(12):
        noise[k] = decay * noise[k] + kick * gaussian(seed, tick, FIRST_CHANNEL + k)


@kernel
def measure(sensors, noise, qpos, qvel, measured_pos, measured_vel):
    """Estimate of the vehicle's state.

    Args:
        sensors: strengths. noise: (12,) errors in standard deviations.
        qpos, qvel: true state, base first; longer than the vehicle's own if the scene holds more.
        measured_pos: (7 + J,) written. measured_vel: (6 + J,) written.
    """
    measured_pos[:] = qpos[: measured_pos.size]
    measured_vel[:] = qvel[: measured_vel.size]
    put(measured_pos, 0, add(vec(qpos, 0), scale(sensors.position, vec(noise, 0))))
    put(measured_vel, 0, add(vec(qvel, 0), scale(sensors.velocity, vec(noise, 3))))
    put(measured_vel, 3, add(vec(qvel, 3), scale(sensors.rate, vec(noise, 9))))
    x, y, z = scale(0.5 * sensors.attitude, vec(noise, 6))
    w, qx, qy, qz = qpos[3], qpos[4], qpos[5], qpos[6]  # times the small rotation (1, x, y, z), then normalised
    turned = (
        w - x * qx - y * qy - z * qz,
        qx + w * x + qy * z - qz * y,
        qy + w * y + qz * x - qx * z,
        qz + w * z + qx * y - qy * x,
    )
    length = math.sqrt(turned[0] ** 2 + turned[1] ** 2 + turned[2] ** 2 + turned[3] ** 2)
    for k in range(4):
        measured_pos[3 + k] = turned[k] / length
