"""Devices, one file and one ``conf/device/NAME.yaml`` each.

A module says the names of its ``CONTROLS``; one of a device that no browser reads has a ``DRIVER`` too, whose settings
are the ``hardware`` of its YAML. Whatever flies is asked as a :class:`aerial_il.core.contracts.Device`.
"""

import importlib
import pkgutil
from collections.abc import Mapping
from types import ModuleType
from typing import Any

from aerial_il.core.composition import build
from aerial_il.core.errors import UnknownNameError
from aerial_il.teleop.input.hardware import Driver
from aerial_il.teleop.input.mapping import Bindings, read_bindings, together

HARDWARE = "hardware"  # key of a device's YAML beside its commands


def names() -> tuple[str, ...]:
    """Return the names of all devices."""
    return tuple(sorted(module.name for module in pkgutil.iter_modules(__path__)))


def controls_of(name: str) -> tuple[str, ...]:
    """Return the names of a device's keys and buttons.

    Raises:
        UnknownNameError: there is no such device.
    """
    return _module(name).CONTROLS


def bindings_of(mappings: Mapping[str, Mapping[str, Any]]) -> Bindings:
    """Return the bindings of the devices named, ``name -> content of its YAML``, used at once."""
    return together(
        read_bindings({c: bound for c, bound in raw.items() if c != HARDWARE}, controls_of(name), device=name)
        for name, raw in mappings.items()
    )


def drivers_of(
    mappings: Mapping[str, Mapping[str, Any]], changed: Mapping[str, Mapping[str, Any]] | None = None
) -> dict[str, Driver]:
    """Return how those of the devices named are opened that no browser reads.

    Args:
        mappings: device -> content of its YAML. changed: device -> settings to take instead of the file's.

    Raises:
        UnknownNameError: a device without such settings, or one that has no setting of that name.
        InvalidValueError: a value of another type than the setting's.
    """
    drivers = {name: _module(name).DRIVER for name in mappings if hasattr(_module(name), "DRIVER")}
    for name in changed or {}:
        if name not in drivers:
            raise UnknownNameError("device with hardware settings among devices=[...]", name, drivers)
    settings = {name: {**mappings[name].get(HARDWARE, {}), **(changed or {}).get(name, {})} for name in drivers}
    return {name: build(driver, settings[name], at=f"hardware.{name}.") for name, driver in drivers.items()}


def _module(name: str) -> ModuleType:
    if name not in names():
        raise UnknownNameError("device", name, names())
    return importlib.import_module(f"{__name__}.{name}")
