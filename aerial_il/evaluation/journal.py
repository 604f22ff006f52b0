"""Keep finished flights on disk while an evaluation goes on, so that a killed one continues where it was.

Each flight is one file of ``flights/``, whole or absent, beside a note of what is evaluated. The folder goes when the
result, its films and its page are written.
"""

import io
import json
import logging
import os
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aerial_il.core.bounded import parse_json, read_json, read_npz
from aerial_il.core.files import write_atomic, write_json
from aerial_il.evaluation.metrics import EpisodeRecord
from aerial_il.evaluation.result import Flight

FOLDER, NOTE = "flights", "evaluated.json"
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Kept:
    """A finished flight as it is kept.

    Attributes:
        record: its numbers. flight: what shows it again. wall_s: seconds that it added to the wall time.
    """

    record: EpisodeRecord
    flight: Flight
    wall_s: float


class Journal:
    """The finished flights of one evaluation.

    Args:
        out: the folder of the evaluation.
    """

    def __init__(self, out: str | os.PathLike[str]) -> None:
        self.path, self._subject = Path(out) / FOLDER, dict[str, Any]()

    def subject(self) -> dict[str, Any] | None:
        """Return what is evaluated here, or None where nothing was started."""
        try:
            subject = read_json(self.path / NOTE)
        except (FileNotFoundError, ValueError):
            return None
        return subject if isinstance(subject, dict) else None

    def start(self, subject: Mapping[str, Any]) -> None:
        """Keep what ends from now on as flights of ``subject``."""
        self._subject = dict(subject)

    def keep(self, kept: Kept) -> None:
        """Write a finished flight."""
        if not (self.path / NOTE).exists():  # a mistake that shows before the first flight leaves nothing behind
            write_json(self.path / NOTE, self._subject)
        flight, buffer = kept.flight, io.BytesIO()
        facts = {"record": kept.record.to_dict(), "phase_names": flight.phase_names, "wall_s": kept.wall_s}
        arrays = {"ee_path": flight.ee_path, "actions": flight.actions, "phase": flight.phase}
        there: dict[str, Any] = {name: array for name, array in arrays.items() if array is not None}
        np.savez_compressed(buffer, facts=np.frombuffer(json.dumps(facts).encode(), np.uint8), **there)
        write_atomic(self._file(kept.record.seed), buffer.getvalue())

    def read(self, seeds: Iterable[int]) -> dict[int, Kept]:
        """Return the finished flights of ``seeds``; one that cannot be read counts as not flown."""
        return {seed: kept for seed in seeds if (kept := self._read(self._file(seed))) is not None}

    def close(self) -> None:
        """Forget the flights: their result is written, or they are not wanted."""
        shutil.rmtree(self.path, ignore_errors=True)

    def _file(self, seed: int) -> Path:
        return self.path / f"{seed}.npz"

    def _read(self, file: Path) -> Kept | None:
        if not file.exists():
            return None
        try:
            shown = read_npz(file, ("facts", "ee_path", "actions", "phase"))
            facts = parse_json(shown.pop("facts").tobytes())
            flight = Flight(**shown, phase_names=tuple(facts["phase_names"]))
            return Kept(EpisodeRecord.from_dict(facts["record"]), flight, facts["wall_s"])
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            log.warning("%s cannot be read (%s); its seed is flown anew.", file, error)
            return None
