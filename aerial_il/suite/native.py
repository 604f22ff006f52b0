"""MuJoCo's own functions, called from compiled code with no Python in between.

A controller that reacts to every physics step and a physics step of a hundredth of a millisecond leave no time for an
interpreter: loops over worlds and steps run in one compiled call, and MuJoCo is called through the addresses of its
structures. Nothing here can raise; whoever calls makes sure of sizes, and looks at MuJoCo's warnings afterwards.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import mujoco
from numba import types
from numba.extending import intrinsic
from numba.np.numpy_support import carray

from aerial_il.core.kernels import kernel

_FOLDER = Path(mujoco.__file__).parent
_LIBRARY = next(path for pattern in ("libmujoco.*", "mujoco.dll") for path in _FOLDER.glob(pattern))
ctypes.CDLL(str(_LIBRARY), mode=ctypes.RTLD_GLOBAL)  # the library that is loaded already: its names become visible

_ADDRESS, _INT, _NOTHING = types.intp, types.int32, types.void
_ON_WORLD = _NOTHING(_ADDRESS, _ADDRESS)  # (mjModel*, mjData*)
_ON_STATE = _NOTHING(_ADDRESS, _ADDRESS, _ADDRESS, _INT)  # (mjModel*, mjData*, mjtNum* state, signature)

mj_step1 = types.ExternalFunction("mj_step1", _ON_WORLD)
mj_step2 = types.ExternalFunction("mj_step2", _ON_WORLD)
mj_reset_data = types.ExternalFunction("mj_resetData", _ON_WORLD)
mj_get_state = types.ExternalFunction("mj_getState", _ON_STATE)
mj_set_state = types.ExternalFunction("mj_setState", _ON_STATE)
mju_copy = types.ExternalFunction("mju_copy", _NOTHING(_ADDRESS, _ADDRESS, _INT))  # (to, from, count of doubles)


@intrinsic
def _pointer(_: Any, address: types.Integer) -> Any:
    """Take an address (integer) as a pointer to doubles."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.float64)(address), generate


_at: Any = _pointer  # an intrinsic is called without its first argument


@kernel
def doubles(address, size):
    """Return the ``size`` doubles at ``address`` as an array, which nobody owns."""
    return carray(_at(address), (size,))
