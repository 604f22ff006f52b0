"""Layout of MuJoCo's ``userdata``: everything an episode remembers beyond the physics.

Controller memory, timers, flags and what disturbances remember live in the simulator's own state vector, so that a
stored state is the whole story: restore it and the episode continues bit for bit, whoever flew it.
"""

from __future__ import annotations

from collections.abc import Mapping

from aerial_il.control.controller_state import CONTROLLER_STATE_SIZE
from aerial_il.control.vehicle import MAX_ROTORS
from aerial_il.suite.timing import SUBSTEPS

CONTROLLER = slice(0, CONTROLLER_STATE_SIZE)
_WIND = slice(CONTROLLER.stop, CONTROLLER.stop + 12)
_NOISE = slice(_WIND.stop, _WIND.stop + 12)
SEED = _NOISE.stop  # episode seed, an integer below 2**53
TICK = SEED + 1  # physics steps since the start
STEP = SEED + 2  # control steps since the start
DWELL = SEED + 3  # control steps for which the success condition has held
CRASHED = SEED + 4  # 1 after a crash
DROPPED = SEED + 5  # 1 once the task's object is out of reach for good
MAX_FORCES = 2  # force sensors that a task may name
FORCES = slice(SEED + 6, SEED + 6 + 4 * MAX_FORCES)  # of each: force as measured (3), then the largest of each so far
SAMPLES = slice(FORCES.stop, FORCES.stop + 6 * SUBSTEPS)  # per physics step: first force as measured (3), and raw (3)
TASK = slice(SAMPLES.stop, SAMPLES.stop + 8)  # for the task's own use
_LATENCY = slice(TASK.stop, TASK.stop + 33)
MAX_OBJECTS = 4  # that a policy may see, where the task does not say that it has more
ERRORS = slice(_LATENCY.stop, _LATENCY.stop + 6 * MAX_OBJECTS)  # of each as seen, in standard deviations: pos, rotation
MAX_LAG = 4  # control steps by which they may be seen late
PAST_SIZE = 14  # numbers of what moves of them, 7 for a pose, 2 for a joint; likewise
PAST = slice(ERRORS.stop, ERRORS.stop + MAX_LAG * PAST_SIZE)  # as it was, see ``estimation``
THRUST = slice(PAST.stop, PAST.stop + MAX_ROTORS)  # of each rotor, N
COMMAND = slice(THRUST.stop, THRUST.stop + MAX_ROTORS)  # to each rotor in the last physics step, N
AIR = slice(COMMAND.stop, COMMAND.stop + 3)  # force of the air on the base in that step, world, N
USERDATA_SIZE = AIR.stop  # without what further disturbances and tasks that show more remember, which follows

# What disturbances remember, where recordings have it in every tier; see ``episode.disturbances`` for all others.
MEMORIES: Mapping[str, slice] = {
    "wind": _WIND,
    "noise": _NOISE,
    "latency": _LATENCY,
    "estimation": slice(ERRORS.start, PAST.stop),
}


def sight_size(objects: int, moving: int) -> int:
    """Numbers that the sight of ``objects`` with ``moving`` numbers needs behind this layout: none if it fits in."""
    if objects <= MAX_OBJECTS and moving <= PAST_SIZE:
        return 0
    return 6 * objects + MAX_LAG * moving
