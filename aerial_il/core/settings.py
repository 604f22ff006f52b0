"""Settings as configuration files and command lines give them, made into what a frozen dataclass says they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

from aerial_il.core.errors import UnknownNameError


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


def plain(settings: Any) -> Any:
    """Return nested dataclasses as plain values, with the name of their class where they stand for a choice."""
    if is_dataclass(settings) and not isinstance(settings, type):
        inner = {f.name: plain(getattr(settings, f.name)) for f in fields(settings)}
        return {"kind": type(settings).__name__, **inner}
    if isinstance(settings, Mapping):
        return {str(key): plain(value) for key, value in settings.items()}
    if isinstance(settings, (tuple, list)):
        return [plain(value) for value in settings]
    return settings if isinstance(settings, (int, float, str, bool, type(None))) else type(settings).__name__


def changed[Settings](settings: Settings, changes: Mapping[str, Any]) -> Settings:
    """Return a frozen dataclass with some of its values changed.

    Args:
        changes: name of a setting -> its value or, where that is a dataclass too, the changes of that.

    Raises:
        UnknownNameError: there is no such setting.
    """
    before: Any = settings
    known = [field.name for field in fields(before)]
    values: dict[str, Any] = {}
    for name, value in changes.items():
        if name not in known:
            raise UnknownNameError(f"setting of {type(settings).__name__}", name, known)
        inner = getattr(before, name)
        values[name] = changed(inner, value) if isinstance(value, Mapping) and is_dataclass(inner) else value
    return replace(before, **values)
