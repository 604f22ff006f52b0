"""What a force sensor reports of a contact: the net force, low-passed, and the largest value of an episode.

The measurement is kept in the episode's own memory, so that it belongs to the state that is stored and restored.
"""

from __future__ import annotations

import math

from aerial_il.core.kernels import kernel
from aerial_il.suite.memory import MAX_FORCES

BANDWIDTH_RAD_S = 100.0  # of the sensor: anything much shorter than a control step is the contact solver's doing


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
