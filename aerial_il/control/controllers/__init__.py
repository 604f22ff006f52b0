"""Flight laws that a vehicle can be flown by, one file each, see ``law.py``.

One vocabulary for environments, configurations and studies. ``docs/controllers.md`` derives each of them.
"""

from typing import Any

from aerial_il.core import registry


def address(name: str, own: Any) -> int:
    """Return the address of a law's kernel for its numbers ``own`` (1,).

    Raises:
        InvalidValueError: it is a plain Python function.
    """
    from aerial_il.control.steering import signature
    from aerial_il.core.kernels import address_of

    return address_of(registry.kernel("controller", name, "steer"), signature(own))
