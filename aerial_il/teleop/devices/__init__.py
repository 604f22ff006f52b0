"""Devices, one file and one ``conf/device/NAME.yaml`` each; what is needed of one is :class:`Device` alone."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from typing import Any, Protocol

from aerial_il.core.errors import UnknownNameError
from aerial_il.teleop.frame import DeviceFrame
from aerial_il.teleop.mapping import Bindings, read_bindings, together


class Device(Protocol):
    """Whatever is asked once a tick."""

    def frame(self) -> DeviceFrame:
        """Return what has arrived since the last call."""
        ...


def names() -> tuple[str, ...]:
    """Return the names of all devices."""
    return tuple(sorted(module.name for module in pkgutil.iter_modules(__path__)))


def controls_of(name: str) -> tuple[str, ...]:
    """Return the names of a device's keys and buttons.

    Raises:
        UnknownNameError: there is no such device.
    """
    if name not in names():
        raise UnknownNameError("device", name, names())
    return importlib.import_module(f"aerial_il.teleop.devices.{name}").CONTROLS


def bindings_of(mappings: Mapping[str, Mapping[str, Any]]) -> Bindings:
    """Return the bindings of the devices named, ``name -> content of its YAML``, used at once."""
    return together(read_bindings(raw, controls_of(name), device=name) for name, raw in mappings.items())
