"""Measurements that a task has compiled for one world, taken of all worlds at once: for experts, studies and tests."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from aerial_il.core.kernels import address_of, kernel
from aerial_il.suite.physics.native import doubles
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import (
    RETURNS_NUMBER,
    RETURNS_VECTOR,
    WRITES_ROW,
    call_number,
    call_row,
    call_vector,
    record_at,
)


def number(compiled: Callable[..., Any]) -> Callable[[View], np.ndarray]:
    """Return the function ``view -> (n,)`` of a kernel ``world -> number``; see ``physics.world``."""
    return lambda view: _measure(_numbers, address_of(compiled, RETURNS_NUMBER), view, np.empty(view.n))


def truth(compiled: Callable[..., Any]) -> Callable[[View], np.ndarray]:
    """Return the function ``view -> (n,) bool`` of a kernel ``world -> bool``."""
    measured = number(compiled)
    return lambda view: measured(view) > 0.0


def vector(compiled: Callable[..., Any]) -> Callable[[View], np.ndarray]:
    """Return the function ``view -> (n, 3)`` of a kernel ``world -> (x, y, z)``."""
    return lambda view: _measure(_vectors, address_of(compiled, RETURNS_VECTOR), view, np.empty((view.n, 3)))


def row(compiled: Callable[..., Any], size: int) -> Callable[[View], np.ndarray]:
    """Return the function ``view -> (n, size)`` of a kernel ``(world, found) -> None`` that writes ``size`` numbers."""
    return lambda view: _measure(_rows, address_of(compiled, WRITES_ROW), view, np.empty((view.n, size)))


def _measure(loop: Callable[..., None], address: int, view: View, found: np.ndarray) -> np.ndarray:
    records = view.records
    loop(address, records.ctypes.data, records.itemsize, found)
    return found


@kernel
def _numbers(address, records, size, found):
    for i in range(found.shape[0]):
        found[i] = call_number(address, record_at(records + i * size))


@kernel
def _vectors(address, records, size, found):
    for i in range(found.shape[0]):
        found[i, 0], found[i, 1], found[i, 2] = call_vector(address, record_at(records + i * size))


@kernel
def _rows(address, records, size, found):
    width = found.shape[1]
    for i in range(found.shape[0]):
        call_row(address, record_at(records + i * size), doubles(found.ctypes.data + 8 * i * width, width))
