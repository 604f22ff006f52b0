"""Flight laws that a vehicle can be flown by, one file each, see ``law.py``.

One vocabulary for environments, configurations and studies. ``docs/controllers.md`` derives each of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from aerial_il.core import registry
from aerial_il.core.errors import InvalidValueError

if TYPE_CHECKING:  # names are listed without importing a compiler
    from aerial_il.control.controllers.law import Law


def names() -> tuple[str, ...]:
    """Names of all laws, in alphabetical order."""
    return registry.names("controller")


def get(name: str) -> type[Law]:
    """Return the class of the law called ``name``.

    Raises:
        UnknownNameError: no law has that name.
    """
    return registry.get("controller", name)


def kernel_of(name: str) -> Any:
    """Return the compiled function ``steer`` of a law.

    Raises:
        InvalidValueError: its file has none, or a plain Python function.
    """
    module = registry.module("controller", name)
    found = getattr(module, "steer", None)
    if not hasattr(found, "py_func"):
        raise InvalidValueError(f"{module.__name__} needs a compiled steer(own, vehicle, gains, scratch, state).")
    return found


def address(name: str, own: Any) -> int:
    """Return the address of a law's kernel for its numbers ``own`` (1,)."""
    from aerial_il.control.steering import signature
    from aerial_il.core.kernels import address_of

    return address_of(kernel_of(name), signature(own))
