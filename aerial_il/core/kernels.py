"""One decorator for every compiled function, so that they all obey the same floating-point rules.

Strict IEEE arithmetic (no ``fastmath``) keeps one world bit-identical to the same world inside a batch. Compiled
code is cached on disk, so only the first run after an edit pays for compilation.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile ``function`` with numba: no Python objects, GIL released, division by zero gives infinity."""
    compiled: Any = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    if hasattr(compiled, "_cache"):  # not under NUMBA_DISABLE_JIT
        cache_file = compiled._cache._cache_file
        cache_file._version = f"{cache_file._version} {_kernel_sources()}"  # looked at before anything is unpickled
    return compiled


@cache
def _kernel_sources() -> str:
    """Digest of all files that compiled code may contain.

    A kernel contains the kernels and constants of other files that it uses, but numba looks only at its own file to
    tell whether a cached one is stale: an edit elsewhere would go unnoticed.
    """
    package, digest = Path(__file__).parent.parent, hashlib.sha256()
    for path in sorted(path for room in ("core", "control", "suite") for path in (package / room).glob("*.py")):
        text = path.read_bytes()
        if b"@kernel" in text or path.parent.name == "control" or path.name == "memory.py":
            digest.update(text)
    return digest.hexdigest()
