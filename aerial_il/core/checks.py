"""What settings must be, by field name: tuples, positive, not negative, a share, widths, one of some choices."""

import math
from dataclasses import fields
from numbers import Integral
from typing import Any, get_args

from aerial_il.core.errors import InvalidValueError


def make_tuples(settings: Any) -> None:
    """Turn what stands for a tuple among the fields of a frozen dataclass into one.

    A list, as YAML and JSON know them, becomes a tuple; a single name or number the tuple of it alone, where it would
    otherwise be taken for a sequence of letters. To be called first in ``__post_init__``.
    """
    for field in fields(settings):
        value = getattr(settings, field.name)
        if isinstance(value, list):
            object.__setattr__(settings, field.name, tuple(value))
        elif isinstance(value, str | int | float) and str(field.type).startswith("tuple["):
            object.__setattr__(settings, field.name, (value,))


def require_positive(settings: object, *names: str) -> None:
    """Raise :class:`InvalidValueError` unless every named setting is positive."""
    for name in names:
        if not getattr(settings, name) > 0:
            raise InvalidValueError(f"{name} is {getattr(settings, name)}; it must be positive.")


def require_not_negative(settings: object, *names: str) -> None:
    """Raise :class:`InvalidValueError` if a named setting is negative."""
    for name in names:
        if not getattr(settings, name) >= 0:
            raise InvalidValueError(f"{name} is {getattr(settings, name)}; it must not be negative.")


def require_share(settings: object, *names: str, below_one: bool = False) -> None:
    """Raise :class:`InvalidValueError` unless every named setting lies between 0 and 1."""
    for name in names:
        value = getattr(settings, name)
        if not 0 <= value <= 1 or (below_one and value == 1):
            raise InvalidValueError(f"{name} is {value}; it must lie in [0, 1{')' if below_one else ']'}.")


def require_integer(name: str, value: object, least: int, most: float = math.inf, hint: str = "") -> None:
    """Raise :class:`InvalidValueError` unless ``value`` is an integer between ``least`` and ``most``."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not least <= int(value) <= most:
        bounds = f"at least {least}" if most == math.inf else f"in [{least}, {most}]"
        raise InvalidValueError(f"{name} is {value!r}; it must be an integer, {bounds}. {hint}".rstrip())


def require_widths(settings: object, name: str) -> None:
    """Raise :class:`InvalidValueError` unless the named setting is at least one positive width."""
    value = getattr(settings, name)
    if not value or min(value) < 1:
        raise InvalidValueError(f"{name} is {value}; it must name at least one positive width.")


def require_choice(settings: object, name: str, choices: object) -> None:
    """Raise :class:`InvalidValueError` unless the named setting is one of a ``Literal``'s values."""
    if getattr(settings, name) not in get_args(choices):
        valid = ", ".join(get_args(choices))
        raise InvalidValueError(f"Unknown {name} {getattr(settings, name)!r}. Valid: {valid}.")
