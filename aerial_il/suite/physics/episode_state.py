"""Layout of MuJoCo's ``userdata``: everything an episode remembers beyond the physics.

Controller memory, wind, timers, flags and late actions live in the simulator's own state vector, so that a stored state
is the whole story: restore it and the episode continues bit for bit, whoever flew it.
"""

from __future__ import annotations

from aerial_il.control.controller_state import CONTROLLER_STATE_SIZE
from aerial_il.suite.physics.latency import MAX_ACTION, MAX_DELAY
from aerial_il.suite.physics.wind import WIND_SIZE
from aerial_il.suite.timing import SUBSTEPS

CONTROLLER = slice(0, CONTROLLER_STATE_SIZE)
WIND = slice(CONTROLLER_STATE_SIZE, CONTROLLER_STATE_SIZE + WIND_SIZE)  # filter states, velocity, direction
NOISE = slice(WIND.stop, WIND.stop + 12)  # errors of the state estimate, in standard deviations
SEED = NOISE.stop  # episode seed, an integer below 2**53
TICK = SEED + 1  # physics steps since the start
STEP = SEED + 2  # control steps since the start
DWELL = SEED + 3  # control steps for which the success condition has held
CRASHED = SEED + 4  # 1 after a crash
DROPPED = SEED + 5  # 1 once the task's object is out of reach for good
MAX_FORCES = 2  # force sensors that a task may name
FORCES = slice(SEED + 6, SEED + 6 + 4 * MAX_FORCES)  # of each: force as measured (3), then the largest of each so far
SAMPLES = slice(FORCES.stop, FORCES.stop + 6 * SUBSTEPS)  # per physics step: first force as measured (3), and raw (3)
TASK = slice(SAMPLES.stop, SAMPLES.stop + 8)  # for the task's own use
DELAY = TASK.stop  # control steps by which actions come late
QUEUE = slice(DELAY + 1, DELAY + 1 + MAX_DELAY * MAX_ACTION)  # actions on their way
MAX_OBJECTS = 4  # that a policy may see
ERRORS = slice(QUEUE.stop, QUEUE.stop + 6 * MAX_OBJECTS)  # of each as seen: position, rotation, in standard deviations
MAX_LAG = 4  # control steps by which they may be seen late
PAST_SIZE = 14  # numbers of what moves of them: 7 for a pose, 2 for a joint
PAST = slice(ERRORS.stop, ERRORS.stop + MAX_LAG * PAST_SIZE)  # as it was, see ``estimation``
USERDATA_SIZE = PAST.stop
