"""Force sensors of contacts: the net force, low-passed, and the largest value of an episode.

The measurement is taken at every physics step and kept in the episode's own memory, so that it belongs to the state
that is stored and restored.
"""

from __future__ import annotations

import math

from aerial_il.core.kernels import kernel
from aerial_il.suite.physics.episode_state import MAX_FORCES, SAMPLES

# First order. Sensors for the wrist of a robot filter so: OptoForce (now OnRobot) HEX offers 500, 150, 50, 15, 5 and
# 1.5 Hz, of which its ROS driver (shadow-robot/optoforce, optoforce.launch) takes 15 Hz; Robotiq's FT 300-S sends 100
# values a second (instruction manual, 4.4.2), so that it can tell nothing beyond 50 Hz.
BANDWIDTH_HZ = 15.0
BANDWIDTH_RAD_S = 2.0 * math.pi * BANDWIDTH_HZ
FIRST_SAMPLE = SAMPLES.start


@kernel
def sense_forces(sensordata, addresses, forces, dt):
    """Advance the measurements by ``dt`` s.

    Args:
        sensordata: (m,) of one world. addresses: (K,) first index of each force sensor, three numbers each.
        forces: (4 MAX_FORCES,) measured forces, N, then the largest of each so far, N; changed in place.
    """
    share = 1.0 - math.exp(-BANDWIDTH_RAD_S * dt)
    for k in range(addresses.size):
        total = 0.0
        for axis in range(3):
            i = 3 * k + axis
            forces[i] += share * (sensordata[addresses[k] + axis] - forces[i])
            total += forces[i] * forces[i]
        forces[3 * MAX_FORCES + k] = max(forces[3 * MAX_FORCES + k], math.sqrt(total))


@kernel
def keep_sample(sensordata, addresses, forces, userdata, tick):
    """Keep the first force, as measured and raw, of physics step ``tick`` of the present control step."""
    if addresses.size > 0:
        start = FIRST_SAMPLE + 6 * tick
        for axis in range(3):
            userdata[start + axis] = forces[axis]
            userdata[start + 3 + axis] = sensordata[addresses[0] + axis]
