"""The record of a study: each finished stage is kept by its name and its settings, and is not done twice.

A stage lies in ``KIND/LABEL-DIGEST``: the digest is that of its settings, which ``.record.json`` in it holds in full,
with the commit, the packages and the machine that it was made with. An arm that is added to a study reuses the stages
of the others. What was made by other code counts as well; the log and the notes of the report name its commit, and
``again=true`` makes all anew.
"""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aerial_il.core.files import write_json
from aerial_il.core.provenance import provenance
from experiments.common.report import machine

log = logging.getLogger(__name__)
RECORD = ".record.json"


class Record:
    """The stages below a folder.

    Args:
        folder: of the study.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._commits: dict[str, int] = {}  # other commits than this one -> stages that were made by them

    def place(self, kind: str, label: str, settings: Mapping[str, Any]) -> Path:
        """Return the folder of one stage, which may be there already.

        Args:
            kind: of result, e.g. ``training``. label: what people call it, a path below the kind.
            settings: all that it was told, seeds included, JSON values.
        """
        place = self.folder / kind / f"{label}-{digest(settings)}"
        made = {"settings": settings, **provenance(), "machine": machine()}
        if not (place / RECORD).exists():
            write_json(place / RECORD, json.loads(json.dumps(made)))
        elif (commit := commit_of(json.loads((place / RECORD).read_text()))) != commit_of(made):
            if commit not in self._commits:
                log.info("Results of commit %s are taken as they are; again=true makes them anew.", commit)
            self._commits[commit] = self._commits.get(commit, 0) + 1
        return place

    def notes(self) -> list[str]:
        """Return a sentence that names the other commits which stages were made by, where there are any."""
        said = ", ".join(sorted(self._commits))
        return [f"Stages that were finished before were taken as they are, from commit {said}."] if said else []


def commit_of(made: Mapping[str, Any]) -> str:
    """Return ten characters of the commit that a stage was made by, ``+`` where files had been changed since."""
    git = made["git"]
    return f"{git['sha'][:10]}{'+' * git['dirty']}" if git else "unknown"


def digest(tree: Mapping[str, Any]) -> str:
    """Return a short digest of JSON values; the order of keys does not matter."""
    return hashlib.sha256(json.dumps(tree, sort_keys=True, allow_nan=False).encode()).hexdigest()[:12]
