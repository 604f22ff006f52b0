"""Settings of studies as plain values, which decide what is kept under which name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

# Settings that came later, with the values at which all is as it was without them: records from before count as these.
LATER = {
    ("BC", "auxiliary"): 0.0,
    ("DAgger", "stale_rounds"): 0,
    ("Perception", "device"): "cpu",
    ("Perception", "execute"): 0,
    ("Out", "lead"): 0,
}


def plain(settings: Any) -> Any:
    """Return nested dataclasses as plain values, with the name of their class where they stand for a choice."""
    if is_dataclass(settings) and not isinstance(settings, type):
        kind, inner = type(settings).__name__, {f.name: plain(getattr(settings, f.name)) for f in fields(settings)}
        as_before = {name for name, value in inner.items() if LATER.get((kind, name), ...) == value}
        return {"kind": kind, **{name: value for name, value in inner.items() if name not in as_before}}
    if isinstance(settings, Mapping):
        return {str(key): plain(value) for key, value in settings.items()}
    if isinstance(settings, (tuple, list)):
        return [plain(value) for value in settings]
    return settings if isinstance(settings, (int, float, str, bool, type(None))) else type(settings).__name__
