"""One decorator for every compiled function, so that they all obey the same floating-point rules.

Strict IEEE arithmetic (no ``fastmath``) keeps one world bit-identical to the same world inside a batch. Compiled
code is cached on disk, so only the first run after an edit pays for compilation.
"""

import hashlib
import logging
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import event, sigutils
from numba.core.ccallback import CFunc

log = logging.getLogger(__name__)

PACKAGE = Path(__file__).parent.parent
OPTIONS: dict[str, Any] = {"error_model": "numpy"}  # division by zero gives infinity
WHOLE = ("control", "suite/physics")  # their constants are compiled in, too
# Folders whose kernels are called by address, so that nothing else is compiled anew for them, and whose they use.
CALLED = {
    "suite/tasks": ("suite/tasks", "suite/props"),
    "suite/props": ("suite/tasks", "suite/props"),
    "experts": ("suite/tasks", "suite/props"),
    "suite/disturbances": ("suite/disturbances",),
    "suite/sensors": ("suite/sensors",),
    "control/controllers": ("control/controllers",),
}


class _FirstCompilation(event.Listener):
    """Says, once a process, why nothing seems to happen where the cache on disk has not what is called."""

    said = False

    def on_start(self, event: event.Event) -> None:
        if not self.said:
            log.info("Compiling what flies here, once for all that is new to it: seconds, after an edit a minute.")
        self.said = True

    def on_end(self, event: event.Event) -> None:
        pass


event.register("numba:compile", _FirstCompilation())


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile ``function`` with numba: no Python objects, GIL released, division by zero gives infinity."""
    compiled: Any = numba.njit(cache=True, nogil=True, **OPTIONS)(function)
    _mark(getattr(compiled, "_cache", None), function)
    return compiled


def entry_of(compiled: Any, *arguments: Any) -> Callable[..., Any]:
    """Entry of a :func:`kernel` for arguments of the types of these, compiled if it must be.

    To tell the types of two dozen arrays in nested tuples takes 8 µs at each call; calling this takes 2 µs. It trusts
    its arguments: whoever calls keeps to the types, the order of arrays in memory included.
    """
    signature = tuple(numba.typeof(argument) for argument in arguments)
    return compiled.compile(signature)


_handed_out: dict[tuple[Any, Any], Any] = {}  # what has an address must live


def address_of(compiled: Any, signature: Any) -> int:
    """Address of a :func:`kernel` as a C function of the given numba ``signature``; compiled at the first call.

    Compiled code calls it through that address, and need not be compiled anew for each function it may call.
    """
    key = compiled, signature
    if key not in _handed_out:
        given = sigutils.normalize_signature(signature)
        callback: Any = CFunc(compiled.py_func, given, {}, {"nopython": True, **OPTIONS})
        callback.enable_caching()
        _mark(callback._cache, compiled.py_func)
        callback.compile()
        _handed_out[key] = callback
    return _handed_out[key].address


def _mark(cache: Any, function: Callable[..., Any]) -> None:
    """Let what is cached on disk be stale after an edit to any file whose code or constants it may contain."""
    if cache is not None and hasattr(cache, "_cache_file"):  # not under NUMBA_DISABLE_JIT
        file = cache._cache_file
        file._version = f"{file._version} {_sources_of(function)}"  # looked at before anything is unpickled


def _sources_of(function: Callable[..., Any]) -> str:
    """Digests of what a kernel may contain: those of other packages use whatever we have, and their own folder."""
    file = Path(function.__code__.co_filename)
    if not file.is_relative_to(PACKAGE):
        return _kernel_sources() + "".join(map(_folder_sources, sorted({*map(PACKAGE.joinpath, CALLED), file.parent})))
    used = CALLED.get(file.parent.relative_to(PACKAGE).as_posix(), ())
    return _kernel_sources() + "".join(_folder_sources(PACKAGE / folder) for folder in used)


@cache
def _kernel_sources() -> str:
    """Digest of all files that compiled code may contain.

    A kernel contains the kernels and constants of other files that it uses, but numba looks only at its own file to
    tell whether a cached one is stale: an edit elsewhere would go unnoticed.
    """
    return _digest(_kernel_files())


def _kernel_files() -> set[Path]:
    whole = (path for folder in WHOLE for path in (PACKAGE / folder).glob("*.py"))
    some = (path for folder in ("core", "suite", "suite/episode") for path in (PACKAGE / folder).glob("*.py"))
    return {
        *whole,
        *(path for path in some if path.name in ("timing.py", "addresses.py") or b"@kernel" in path.read_bytes()),
    }


@cache
def _folder_sources(folder: Path) -> str:
    """The same of the files in one folder, which change more often than what flies."""
    return _digest(folder.glob("*.py"))


def _digest(paths: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(path.read_bytes())
    return digest.hexdigest()
