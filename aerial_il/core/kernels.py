"""One decorator for every compiled function, so that they all obey the same floating-point rules.

Strict IEEE arithmetic (no ``fastmath``) keeps one world bit-identical to the same world inside a batch. Compiled
code is cached on disk, so only the first run after an edit pays for compilation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile ``function`` with numba: no Python objects, GIL released, division by zero gives infinity."""
    return numba.njit(cache=True, nogil=True, error_model="numpy")(function)
