"""Output of an evaluation: numbers, films, a page."""

import shutil
from dataclasses import dataclass
from pathlib import Path

from aerial_il.core.contracts import BatchEnv, Policy
from aerial_il.data.dataset import open_dataset
from aerial_il.evaluation.curves import DatasetSummary
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.presentation.films.video import Clip, Footage, film
from aerial_il.presentation.pages.report import write_report

VIDEOS = "videos"
PAGE = "report.html"


@dataclass(frozen=True)
class Written:
    """What an evaluation left in its folder: numbers, a page, and what is to be said of the films."""

    file: Path
    page: Path
    note: str


def save(
    result: EvaluationResult, folder: Path, *, env: BatchEnv, policy: Policy, videos: int, progress: bool = False
) -> Written:
    """Write evaluation.json, films of ``videos`` successes and failures each, and the page."""
    file = result.save(folder)
    shutil.rmtree(folder / VIDEOS, ignore_errors=True)  # of a result that was here before
    footage = Footage()
    if videos:
        shown = {"successes": videos, "failures": videos, "policy": policy}
        footage = film(env, result, folder / VIDEOS, **shown, progress=progress)
    command = str(result.provenance.get("command", ""))
    page = write_report(folder / PAGE, result, footage=footage, command=command)
    return Written(Path(file), Path(page), footage.note)


def footage_of(folder: Path, result: EvaluationResult) -> Footage:
    """Return the films that :func:`save` left in ``folder``."""
    films = {path.name: path for path in (folder / VIDEOS).glob("*.mp4")}
    named = ((films.get(f"seed_{episode.seed}_{episode.end}.mp4"), episode) for episode in result.episodes)
    return Footage(tuple(Clip(path, episode) for path, episode in named if path is not None))


def summary_of(dataset: str) -> DatasetSummary:
    """Sum up the demonstrations in a folder."""
    return DatasetSummary.of(dataset, open_dataset(dataset))
