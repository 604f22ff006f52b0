"""Settings as configuration files and command lines give them, made into what a frozen dataclass says they are."""

from __future__ import annotations

from dataclasses import fields
from typing import Any


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
