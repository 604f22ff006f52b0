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
from experiments.common.success import success_row

ERROR, NOTED = "aerial-il: ", "Warning: The policy"
SUCCESS = ("success", "episodes", "percent", "ci95_low", "ci95_high")
ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Said:
    """What a command answered.

    Attributes:
        ok: whether it did what it was asked. seconds: wall time. out, err: its lines.
    """

    ok: bool
    seconds: float
    out: tuple[str, ...]
    err: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """The line that it ended with, an error where it failed."""
        lines = self.out if self.ok else self.err
        return lines[-1].removeprefix(ERROR) if lines else ""

    @property
    def ours(self) -> tuple[str, ...]:
        """Its warnings and errors, without what libraries say."""
        return tuple(line for line in self.err if line.startswith(("Warning:", ERROR)))


def call(*words: str, at: Path) -> Said:
    """Run the command in the folder ``at``, on one thread."""
    paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    env = {**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1"}
    started = time.perf_counter()
    command = [sys.executable, "-m", "aerial_il", *words]
    done = subprocess.run(command, cwd=at, env=env, capture_output=True, text=True, check=False)
    seconds = round(time.perf_counter() - started, 1)
    return Said(done.returncode == 0, seconds, _lines(done.stdout), _lines(done.stderr))


def opened(path: Path) -> Row:
    """Return what a file holds, and how long opening and reading it all takes; nothing where it is refused."""
    started = time.perf_counter()
    try:
        episodes = [(len(each), each.success) for each in open_dataset(path, cameras=True, failures=True)]
    except AerialError:
        return {"episodes": 0, "successes": 0, "steps": 0, "opens_s": None}
    steps, successes = (sum(column) for column in zip(*episodes, strict=True))
    seconds = round(time.perf_counter() - started, 2)
    return {"episodes": len(episodes), "successes": successes, "steps": steps, "opens_s": seconds}


def flight_row(judged: Path, name: str, said: Said, trained_s: float | None, told: str) -> Row:
    """Return the row of a policy: what it was told beside its file, how it flew, and what was said of it."""
    row: Row = {"file": name, "told": told, "train_s": trained_s}
    if not said.ok:
        return {**row, **dict.fromkeys((*SUCCESS, "return")), "said": said.verdict}
    result = load_result(judged)
    flew = success_row(result)
    mean = round(float(np.mean([episode.return_ for episode in result.episodes])), 1)
    noted = next((line for line in said.err if line.startswith(NOTED)), "").removeprefix("Warning: ")
    return {**row, **{key: flew[key] for key in SUCCESS}, "return": mean, "said": noted}


def size_mb(path: Path) -> float:
    """Return the size of a file, or of all in a folder."""
    files = [file for file in path.rglob("*") if file.is_file()] if path.is_dir() else [path]
    return round(sum(file.stat().st_size for file in files) / 1e6, 2)


def _lines(text: str) -> tuple[str, ...]:
    return tuple(filter(None, (" ".join(line.split()) for line in text.splitlines())))
