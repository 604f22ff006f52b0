"""The steps of a user with a file: commands in processes of their own, and what came of them."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aerial_il.core.errors import AerialError
from aerial_il.data.dataset import open_dataset
from aerial_il.evaluation.result import load_result
from experiments.common.report import Row

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Said:
    """What a command answered.

    Attributes:
        ok: whether it did what it was asked. seconds: wall time. lines: its words, those on stderr last.
    """

    ok: bool
    seconds: float
    lines: tuple[str, ...]

    @property
    def last(self) -> str:
        """The last line that it said."""
        return self.lines[-1].removeprefix("aerial-il: ") if self.lines else ""


def call(*words: str, at: Path) -> Said:
    """Run the command in the folder ``at``, on one thread."""
    paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    env = {**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1"}
    started = time.perf_counter()
    command = [sys.executable, "-m", "aerial_il", *words]
    done = subprocess.run(command, cwd=at, env=env, capture_output=True, text=True, check=False)
    lines = (" ".join(line.split()) for line in (done.stdout + done.stderr).splitlines())
    return Said(done.returncode == 0, round(time.perf_counter() - started, 1), tuple(filter(None, lines)))


def opened(path: Path) -> Row:
    """Return what a file holds, and how long opening and reading it all takes; nothing where it is refused."""
    started = time.perf_counter()
    try:
        steps = [len(episode) for episode in open_dataset(path, cameras=True, failures=True)]
    except AerialError:
        return {"episodes": 0, "steps": 0, "opens_s": None}
    return {"episodes": len(steps), "steps": sum(steps), "opens_s": round(time.perf_counter() - started, 2)}


def flight_row(judged: Path, name: str, said: Said, trained_s: float | None, told: str) -> Row:
    row: Row = {"file": name, "told": told, "train_s": trained_s}
    if not said.ok:
        none = dict.fromkeys(("success", "episodes", "percent", "ci95_low", "ci95_high", "return"))
        return {**row, **none, "said": said.last}
    result = load_result(judged)
    low, high = (round(100 * end, 1) for end in result.success["ci95"])
    return {
        **row,
        "success": result.success["count"],
        "episodes": len(result.episodes),
        "percent": round(100 * result.success["rate"], 1),
        "ci95_low": low,
        "ci95_high": high,
        "return": round(float(np.mean([episode.return_ for episode in result.episodes])), 1),
        "said": "",
    }


def size_mb(path: Path) -> float:
    files = [file for file in path.rglob("*") if file.is_file()] if path.is_dir() else [path]
    return round(sum(file.stat().st_size for file in files) / 1e6, 2)
