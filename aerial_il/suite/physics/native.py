"""MuJoCo's own functions, called from compiled code with no Python in between.

A controller that reacts to every physics step and a physics step of a hundredth of a millisecond leave no time for an
interpreter: loops over worlds and steps run in one compiled call, and MuJoCo is called through the addresses of its
structures. Nothing here can raise; whoever calls makes sure of sizes, and looks at MuJoCo's warnings afterwards.

The Python package has MuJoCo read the clock around every stage of a step, for a profiler that nobody looks at here; a
fifth of a light scene's time goes into it. Importing this module switches the timers off for the process.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import llvmlite.ir as ir
import mujoco
from numba import types
from numba.np.numpy_support import carray

from aerial_il.core.addresses import intrinsic, read_at
from aerial_il.core.kernels import kernel

_FOLDER = Path(mujoco.__file__).parent
_LIBRARY = next(path for pattern in ("libmujoco.*", "mujoco.dll") for path in _FOLDER.glob(pattern))
_loaded = ctypes.CDLL(str(_LIBRARY), mode=ctypes.RTLD_GLOBAL)  # again: its names become visible to compiled code
_clock = ctypes.c_void_p.in_dll(_loaded, "mjcb_time")  # function that MuJoCo reads its timers with, or null
_clock.value = None

_ADDRESS, _INT, _NOTHING = types.intp, types.int32, types.void
_ON_WORLD = _NOTHING(_ADDRESS, _ADDRESS)  # (mjModel*, mjData*)
_ON_STATE = _NOTHING(_ADDRESS, _ADDRESS, _ADDRESS, _INT)  # (mjModel*, mjData*, mjtNum* state, signature)

mj_step1 = types.ExternalFunction("mj_step1", _ON_WORLD)
mj_step2 = types.ExternalFunction("mj_step2", _ON_WORLD)
mj_reset_data = types.ExternalFunction("mj_resetData", _ON_WORLD)
mj_get_state = types.ExternalFunction("mj_getState", _ON_STATE)
mj_set_state = types.ExternalFunction("mj_setState", _ON_STATE)
mju_copy = types.ExternalFunction("mju_copy", _NOTHING(_ADDRESS, _ADDRESS, _INT))  # (to, from, count of doubles)
mju_mat2quat = types.ExternalFunction("mju_mat2Quat", _NOTHING(_ADDRESS, _ADDRESS))  # (to, from)


@intrinsic
def _at(_: Any, address: types.Integer) -> Any:
    """Take an address (integer) as a pointer to doubles."""
    return types.CPointer(types.float64)(address), read_at


@intrinsic
def _take_one(_: Any, address: types.Integer) -> Any:
    """Add one to the 64-bit integer at an address, in one indivisible step, and return what was there before."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = builder.inttoptr(arguments[0], context.get_value_type(types.CPointer(types.int64)))
        return builder.atomic_rmw("add", place, context.get_constant(types.int64, 1), "monotonic")

    return types.int64(address), generate


@intrinsic
def _fetch(_: Any, address: types.Integer) -> Any:
    """Ask for the cache line at an address, to be read soon, without waiting for it."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [pointer, number, number, number])
        fetch = builder.module.declare_intrinsic("llvm.prefetch", [pointer], kind)
        reading, second_level, data = number(0), number(2), number(1)
        builder.call(fetch, [builder.inttoptr(arguments[0], pointer), reading, second_level, data])
        return context.get_dummy_value()

    return types.void(address), generate


@kernel
def fetch_ahead(address, size):
    """Ask for the ``size`` bytes at an address, see :func:`_fetch`."""
    for line in range(address, address + size, 64):
        _fetch(line)


def stack_end(data: mujoco.MjData) -> int:
    """Return the address behind MuJoCo's stack of a world, which grows downwards from the end of its arena."""
    pointer, size = ctypes.c_void_p(data._address), 64
    allocate = _loaded.mj_stackAllocByte
    allocate.restype, allocate.argtypes = ctypes.c_size_t, [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_size_t]
    _loaded.mj_markStack(pointer)
    found = allocate(pointer, size, size)
    _loaded.mj_freeStack(pointer)
    return found + size


@kernel
def doubles(address, size):
    """Return the ``size`` doubles at ``address`` as an array, which nobody owns."""
    return carray(_at(address), (size,))


@kernel
def row_at(array, i):
    """Row ``i`` of an array (n, k) of doubles, taken by its address.

    Compiled code counts the owners of an array whenever it hands it on; two threads that count on the same array wait
    for each other all the time.
    """
    return doubles(array.ctypes.data + 8 * i * array.shape[1], array.shape[1])


@kernel
def draw(counter):
    """Return the next number, from 0 on, of the ``int64`` counter at an address; no two threads get the same one."""
    return _take_one(counter)
