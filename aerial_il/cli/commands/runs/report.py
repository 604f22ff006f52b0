"""Write one HTML page that opens offline, about an evaluation, a training run, or several runs side by side.

Of an evaluation: success, metrics, videos, provenance. Of a run: success and loss over training, error by action
element, whatever else was logged, predictions beside demonstrations, a learned reward, films. Several runs, or the
folder of a sweep, are grouped by settings, the seeds of each group together. Of a folder of recordings: every episode
with pictures, its length and smoothness, by who flew it.

Example: aerial-il report runs/pick_bc/evaluation run=runs/pick_bc dataset=datasets/pick
Example: aerial-il report runs/pick_bc
Example: aerial-il report datasets/pick_by_hand
Example: aerial-il report runs/pick_mlp runs/pick_act out=runs/classes.html
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from aerial_il.cli.configuration.keys import MISSING, MaybeLocated, at_least, key, path
from aerial_il.core.errors import InvalidValueError

if TYPE_CHECKING:
    from aerial_il.evaluation.training_run import TrainingRun

PAGE = "report.html"


@dataclass
class Config:
    result: list[str] = key(MISSING, "folder of an evaluation, of a run, or of several runs", position=0, many=True)
    run: str | None = key(None, "training run whose curves are shown beside an evaluation")
    dataset: MaybeLocated = path(MaybeLocated, "demonstrations to summarise, or that a run learned from")
    learning_curve: dict[int, str] = key({}, "number of demonstrations -> evaluation: {10:runs/a,25:runs/b}")
    videos: int = key(1, "films of successes and of failures of a run that has none")
    out: str | None = key(None, "the page; report.html beside what it is about by default")

    def __post_init__(self) -> None:
        at_least(self, videos=0)
        if not self.result:
            raise InvalidValueError("result=[] names nothing to report: give a folder, e.g. aerial-il report runs/NAME")


def run(config: Config) -> None:
    """Write the page and say where."""
    from aerial_il.evaluation.training_run import find_runs, read_run

    if flown := [place for place in config.result if _is_dataset(place)]:
        print(f"Report: {_of_session(config, flown)}")
        return
    runs = [read_run(found) for place in config.result for found in find_runs(place)]
    if not runs:
        page = _of_evaluation(config)
    elif len(runs) == 1:
        page = _of_run(config, runs[0])
    else:
        page = _of_runs(config, runs)
    print(f"Report: {page}")


def _is_dataset(place: str) -> bool:
    from aerial_il.data.folder import KINDS, DatasetFolder

    return Path(place).is_dir() and any(DatasetFolder(place).files(kind) for kind in KINDS)


def _of_session(config: Config, flown: list[str]) -> Path:
    from aerial_il.workflows.parts.sessions import write_summary

    if len(config.result) > 1:
        raise InvalidValueError(f"{flown[0]} is a folder of recordings: report it alone.")
    return write_summary(flown[0], config.out)


def _of_evaluation(config: Config) -> Path:
    from aerial_il.evaluation.curves import LearningPoint
    from aerial_il.evaluation.result import load_result
    from aerial_il.presentation.pages.report import write_report
    from aerial_il.workflows.parts import results

    if len(config.result) > 1:
        raise InvalidValueError(f"{config.result[0]} is not a training run; evaluations are reported one at a time.")
    folder = Path(config.result[0])
    folder = folder if folder.is_dir() else folder.parent
    result = load_result(config.result[0])
    return write_report(
        config.out or folder / PAGE,
        result,
        footage=results.footage_of(folder, result),
        run=config.run,
        dataset=results.summary_of(config.dataset.path) if config.dataset.path else None,
        learning_curve=[LearningPoint(n, load_result(place)) for n, place in config.learning_curve.items()],
        command=str(result.provenance.get("command", "")),
    )


def _of_run(config: Config, run: TrainingRun) -> Path:
    from aerial_il.presentation.pages.run_report import write_run_report
    from aerial_il.workflows.parts import run_results

    predictions, note = run_results.predictions(run, config.dataset.path)
    rewarded, films = run_results.rewarded(run, config.dataset.path), run_results.footage(run, config.videos)
    return write_run_report(
        config.out or run.path / PAGE,
        run,
        predictions=predictions,
        prediction_note=note,
        rewarded=rewarded,
        footage=films,
    )


def _of_runs(config: Config, runs: list[TrainingRun]) -> Path:
    from aerial_il.presentation.pages.run_report import write_runs_report

    together = os.path.commonpath([run.path.resolve().parent for run in runs])
    return write_runs_report(config.out or Path(together) / PAGE, runs)
