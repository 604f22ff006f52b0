"""Output of an evaluation: numbers, films, a page."""

from __future__ import annotations

import os
from pathlib import Path

from aerial_il.core.contracts import BatchEnv
from aerial_il.data.dataset import open_dataset
from aerial_il.evaluation.curves import DatasetSummary
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.presentation.films.video import Clip, Footage, film
from aerial_il.presentation.pages.report import write_report

VIDEOS = "videos"
PAGE = "report.html"


def save(result: EvaluationResult, out: str | os.PathLike[str], *, env: BatchEnv, videos: int) -> None:
    """Write evaluation.json, films of ``videos`` successes and failures each, and the page; say where they lie."""
    folder = Path(out)
    print(f"Result: {result.save(folder)}")
    footage = film(env, result, folder / VIDEOS, successes=videos, failures=videos) if videos else Footage()
    if footage.note:
        print(footage.note)
    command = str(result.provenance.get("command", ""))
    print(f"Report: {write_report(folder / PAGE, result, footage=footage, command=command)}")


def footage_of(folder: Path, result: EvaluationResult) -> Footage:
    """Return the films that :func:`save` left in ``folder``."""
    films = {path.name: path for path in (folder / VIDEOS).glob("*.mp4")}
    named = ((films.get(f"seed_{episode.seed}_{episode.end}.mp4"), episode) for episode in result.episodes)
    return Footage(tuple(Clip(path, episode) for path, episode in named if path is not None))


def summary_of(dataset: str) -> DatasetSummary:
    """Sum up the demonstrations in a folder."""
    return DatasetSummary.of(dataset, open_dataset(dataset))
