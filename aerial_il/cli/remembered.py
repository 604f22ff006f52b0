"""Keys of a choice for completion: read from its dataclass once, and remembered until a file of the package changes."""

from __future__ import annotations

import json
import os
from pathlib import Path

from aerial_il.core.files import write_atomic

PACKAGE = Path(__file__).resolve().parents[1]


def keys_of(kind: str, name: str) -> list[str]:
    """Return the dotted keys of the choice ``name``; only where they are not remembered is its module imported."""
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "aerial_il" / f"{kind}-{name}.json"
    state = _state()
    try:
        found = json.loads(cache.read_text(encoding="utf-8"))
        if found["state"] == state:
            return found["keys"]
    except (OSError, ValueError, LookupError, TypeError):
        pass
    from aerial_il.core.composition import keys
    from aerial_il.workflows.chosen import chosen

    settings = chosen(kind, name)
    found = [key.name for key in keys(type(settings), base=settings, at=f"{kind}.")]
    cache.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(cache, json.dumps({"state": state, "keys": found}))
    return found


def _state() -> list[int]:
    """Return how many files settings may stand in, and when the newest of them was written."""
    folders = (PACKAGE / "algorithms", PACKAGE / "policies", PACKAGE / "core")
    times = [entry.stat().st_mtime_ns for folder in folders for entry in folder.rglob("*.py")]
    return [len(times), max(times)]
