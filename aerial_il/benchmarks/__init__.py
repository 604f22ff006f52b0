"""Benchmarks, one file each. A module in this folder that defines ``BENCHMARK`` is registered by being there."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

from aerial_il.core.errors import UnknownNameError

if TYPE_CHECKING:
    from aerial_il.benchmarks.parts.reporting.report import Benchmark


@cache
def names() -> tuple[str, ...]:
    """Names of all benchmarks, in alphabetical order, without importing them."""
    return tuple(sorted(m.name for m in iter_modules(__path__) if not m.ispkg))


def get(name: str) -> type[Benchmark]:
    """Return the class of the benchmark called ``name``; its constructor takes the settings.

    Raises:
        UnknownNameError: no benchmark has that name.
    """
    if name not in names():
        raise UnknownNameError("benchmark", name, names())
    return import_module(f"{__name__}.{name}").BENCHMARK
