"""The call of a flight law by the controller's tick: through its address, so that a new law compiles itself only."""

from typing import Any

import numba
import numpy as np
from numba import types

from aerial_il.control.scratch import SCRATCH
from aerial_il.control.vehicle import GAINS, RECORD
from aerial_il.core.addresses import called, intrinsic

_VEHICLE, _GAINS, _SCRATCH = (numba.from_dtype(kind) for kind in (RECORD, GAINS, SCRATCH))
_STATE = types.Array(types.float64, 1, "C")
STEERING = np.dtype([("steer", np.int64), ("own", np.int64)])  # addresses of a law's kernel and of its numbers


def signature(own: np.ndarray) -> Any:
    """Return the numba signature of the kernel of a law with the numbers ``own`` (1,)."""
    return types.void(numba.from_dtype(own.dtype), _VEHICLE, _GAINS, _SCRATCH, _STATE)


@intrinsic
def call_steer(_: Any, address: Any, own: Any, vehicle: Any, gains: Any, scratch: Any, state: Any) -> Any:
    given = (own, _VEHICLE, _GAINS, _SCRATCH, _STATE)
    return types.void(address, own, vehicle, gains, scratch, state), called(types.void, *given)
