"""Layout of MuJoCo's ``userdata``: everything an episode remembers beyond the physics.

Controller memory, gusts, timers and flags live in the simulator's own state vector, so that a stored state is the whole
story: restore it and the episode continues bit for bit, whoever flew it.
"""

from __future__ import annotations

from aerial_il.control.memory import MEMORY_SIZE

CONTROLLER = slice(0, MEMORY_SIZE)
GUST = slice(MEMORY_SIZE, MEMORY_SIZE + 12)  # force and torque: filter state, output
NOISE = slice(MEMORY_SIZE + 12, MEMORY_SIZE + 24)  # errors of the state estimate, in standard deviations
SEED = MEMORY_SIZE + 24  # episode seed, an integer below 2**53
TICK = SEED + 1  # physics steps since the start
STEP = SEED + 2  # control steps since the start
DWELL = SEED + 3  # control steps for which the success condition has held
CRASHED = SEED + 4  # 1 after a crash
TASK = slice(SEED + 5, SEED + 13)  # for the task's own use
USERDATA_SIZE = SEED + 13
