"""Settings of a benchmark, kept in its folder: an interrupted run continues, but only with the same ones."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_json

SETTINGS = "settings.json"


def require_settings(folder: Path, settings: Mapping[str, Any], *, free: Sequence[str] = ()) -> None:
    """Write the settings of a new folder; refuse a folder whose results were made with other settings.

    Args:
        folder: where results are kept. settings: of this run, JSON values. free: settings that may differ, because
            they only choose which results are wanted.

    Raises:
        InvalidValueError: the folder holds results of other settings.
    """
    kept = folder / SETTINGS
    if not kept.exists():
        write_json(kept, dict(settings))
        return
    before = json.loads(kept.read_text())
    changed = [key for key in settings if key not in free and before.get(key) != settings[key]]
    if changed:
        raise InvalidValueError(
            f"{folder} holds results of other settings ({', '.join(changed)}). Choose another out=PATH."
        )
