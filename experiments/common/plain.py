"""Settings of studies as plain values, which decide what is kept under which name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any


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
