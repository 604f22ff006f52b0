"""Learning algorithms: each file of this folder is one, found by its name; what they share lies in its rooms."""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType
from typing import TYPE_CHECKING

from aerial_il.core.errors import UnknownNameError

if TYPE_CHECKING:  # numpy comes with it, which help and completion do without
    from aerial_il.core.contracts import Algorithm


def list_algorithms() -> list[str]:
    """Return the names of all algorithms, without importing them."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__) if not module.ispkg)


def algorithm(name: str) -> ModuleType:
    """Return the module of the algorithm ``name``."""
    if name not in list_algorithms():
        raise UnknownNameError("algorithm", name, list_algorithms())
    return importlib.import_module(f"{__name__}.{name}")


def settings_of(name: str) -> type[Algorithm]:
    """Return the class that holds the settings of the algorithm ``name`` and trains by them."""
    module = algorithm(name)
    return next(one for one in vars(module).values() if isinstance(one, type) and one.__dict__.get("name") == name)
