"""Calls of disturbances by the flight loop: tables of addresses, so that a new one compiles itself and nothing else.

What the kernels of a disturbance are given, beside its own numbers and memory, are two records: the moment
(:data:`NOW`) and the sum of what all disturbances do at it (:data:`EFFECTS`), which aerodynamics and sensing read.
Neither is the record of the world, whose copies in a batch are a flight old.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numba import types

from aerial_il.core.addresses import called, intrinsic, numbers_at, read_at
from aerial_il.core.kernels import kernel
from aerial_il.suite.physics.native import doubles
from aerial_il.suite.physics.world import ROW

NOW = np.dtype(
    [
        *((name, np.float64) for name in ("seed", "tick", "dt")),  # tick: physics steps; dt: s, between control steps
        ("pos", np.float64, (3,)),  # of the base, world, m
        ("quat", np.float64, (4,)),  # wxyz, world from base
        ("vel", np.float64, (3,)),  # world, m/s
        ("rate", np.float64, (3,)),  # base frame, rad/s
    ],
    align=True,
)
EFFECTS = np.dtype(
    [
        ("wind", np.float64, (3,)),  # velocity of the air, world, m/s
        ("lever", np.float64, (3,)),  # where drag attacks, from the base origin, base frame, m
        ("force", np.float64, (3,)),  # on the base, world, N
        ("torque", np.float64, (3,)),  # on the base, base frame, N m
        ("position", np.float64, (3,)),  # error of the estimate: world, m
        ("velocity", np.float64, (3,)),  # world, m/s
        ("attitude", np.float64, (3,)),  # small rotation, base frame, rad
        ("rate", np.float64, (3,)),  # base frame, rad/s
    ],
    align=True,
)
NAMES = ("arrive", "advance", "act")  # of the kernels that a disturbance may have
MAX_DISTURBANCES = 16  # of one tier
HOOKS = np.dtype(
    [
        *((f"num_{name}", np.int64) for name in NAMES),
        # a row a kernel: addresses of it and of its numbers; start and size of its memory in an episode's
        *((name, np.int64, (MAX_DISTURBANCES, 4)) for name in NAMES),
        *((name, np.int64) for name in ("now", "effects")),  # addresses of a record for each world
    ],
    align=True,
)
NOW_SIZE, EFFECTS_SIZE, NUM_EFFECTS = NOW.itemsize, EFFECTS.itemsize, EFFECTS.itemsize // 8
_NOW, _EFFECTS = numba.from_dtype(NOW), numba.from_dtype(EFFECTS)


def signature(name: str, own: np.ndarray) -> Any:
    """Return the numba signature of the kernel called ``name`` of a disturbance whose numbers are ``own`` (1,)."""
    last = {"arrive": (ROW,), "advance": (), "act": (_EFFECTS,)}[name]
    return types.void(numba.from_dtype(own.dtype), ROW, _NOW, *last)


@intrinsic
def now_at(_: Any, address: types.Integer) -> Any:
    return _NOW(address), read_at


@intrinsic
def effects_at(_: Any, address: types.Integer) -> Any:
    return _EFFECTS(address), read_at


@intrinsic
def call_arrive(_: Any, address: Any, own: Any, memory: Any, now: Any, action: Any) -> Any:
    return types.void(address, own, memory, now, action), called(types.void, own, ROW, _NOW, ROW)


@intrinsic
def call_advance(_: Any, address: Any, own: Any, memory: Any, now: Any) -> Any:
    return types.void(address, own, memory, now), called(types.void, own, ROW, _NOW)


@intrinsic
def call_act(_: Any, address: Any, own: Any, memory: Any, now: Any, effects: Any) -> Any:
    return types.void(address, own, memory, now, effects), called(types.void, own, ROW, _NOW, _EFFECTS)


@kernel
def note(now, seed, tick, dt, pos, vel):
    """Write down the moment; ``pos`` (7+) and ``vel`` (6+) as of :func:`sensing.vehicle_state`."""
    now.seed, now.tick, now.dt = seed, tick, dt
    for k in range(3):
        now.pos[k], now.vel[k], now.rate[k] = pos[k], vel[k], vel[3 + k]
    for k in range(4):
        now.quat[k] = pos[3 + k]


@kernel
def arrive_all(hooks, userdata, now, action):
    """Let every disturbance of actions change ``action`` (Da,); ``userdata``: address of the episode's memory."""
    table = hooks.arrive
    for k in range(hooks.num_arrive):
        call_arrive(table[k, 0], numbers_at(table[k, 1]), doubles(userdata + 8 * table[k, 2], table[k, 3]), now, action)


@kernel
def advance_all(hooks, userdata, now):
    """Let every disturbance move on by a control step."""
    table = hooks.advance
    for k in range(hooks.num_advance):
        call_advance(table[k, 0], numbers_at(table[k, 1]), doubles(userdata + 8 * table[k, 2], table[k, 3]), now)


@kernel
def act_all(hooks, userdata, now, address):
    """Sum up what all disturbances do at this moment, in the record of :data:`EFFECTS` at an address."""
    table, numbers = hooks.act, doubles(address, NUM_EFFECTS)
    for k in range(NUM_EFFECTS):
        numbers[k] = 0.0
    effects = effects_at(address)
    for k in range(hooks.num_act):
        call_act(table[k, 0], numbers_at(table[k, 1]), doubles(userdata + 8 * table[k, 2], table[k, 3]), now, effects)
    return effects
