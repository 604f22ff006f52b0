"""The record of a study: each result is stored under a digest of all that decides it.

A result lies in ``KIND/LABEL-DIGEST``: the digest is that of everything that decides it, and ``decided_by.json`` beside
it says what that is. So nothing is computed twice and nothing is out of date: an arm (one method in one setting) that
is added to a study reuses the results of the others. A change of a setting, of how the environment behaves or of the
code that learns gives another digest, and so new flights.
"""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aerial_il.core.files import write_json

log = logging.getLogger(__name__)
DECIDED_BY = "decided_by.json"
DIGITS = 12


class Record:
    """The results below a folder.

    Args:
        folder: of the study.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def place(self, kind: str, label: str, decided_by: Mapping[str, Any]) -> Path:
        """Return the folder of one result, which may be there already; say so where only older ones are.

        Args:
            kind: of result, e.g. ``training``. label: what people call it, a path below the kind.
            decided_by: all that decides the result, JSON values.
        """
        found = self.folder / kind / f"{label}-{digest(decided_by)}"
        if not (found / DECIDED_BY).exists():
            for older in sorted(found.parent.glob(f"{found.name[:-DIGITS]}{'?' * DIGITS}/{DECIDED_BY}")):
                changed = ", ".join(_changed(json.loads(older.read_text()), _plain(decided_by)))
                log.info("%s is made anew; an earlier one was made with other %s.", found.name, changed)
            write_json(found / DECIDED_BY, _plain(decided_by))
        return found


def digest(tree: Mapping[str, Any]) -> str:
    """Return a short digest of JSON values; the order of keys does not matter."""
    text = json.dumps(_plain(tree), sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def _plain(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values as JSON gives them back."""
    return json.loads(json.dumps(tree))


def _changed(before: Any, now: Any, prefix: str = "") -> list[str]:
    """Return the dotted keys whose values differ."""
    if not (isinstance(before, dict) and isinstance(now, dict)):
        return [] if before == now else [prefix.removesuffix(".")]
    keys = sorted(before.keys() | now.keys())
    return [name for key in keys for name in _changed(before.get(key), now.get(key), f"{prefix}{key}.")]
