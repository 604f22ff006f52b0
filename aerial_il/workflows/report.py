"""One HTML page that opens offline, about an evaluation, a training run, or several; or its numbers as rows."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from aerial_il.core.errors import InvalidValueError
from aerial_il.workflows.parts.names import at_least

if TYPE_CHECKING:
    from aerial_il.evaluation.curves import LearningPoint
    from aerial_il.evaluation.training_run import TrainingRun

PAGE = "report.html"
RATES = ("success", "low", "high")  # with its 95 % interval


@dataclass(frozen=True, kw_only=True)
class Report:
    """What the page is about.

    Attributes:
        result: folder of an evaluation, of a run, or of several runs.
        run: training run whose curves are shown beside an evaluation.
        dataset: demonstrations to summarise, or that a run learned from.
        learning_curve: number of demonstrations -> evaluation: {10:runs/a,25:runs/b}.
        videos: films of successes and of failures of a run that has none.
        out: the page; report.html beside what it is about by default.
        progress: show a progress bar while films are made.
    """

    result: tuple[str, ...]
    run: str | None = None
    dataset: str | None = None
    learning_curve: Mapping[int, str] = field(default_factory=dict)
    videos: int = 1
    out: str | None = None
    progress: bool = True

    def __post_init__(self) -> None:
        at_least(self, videos=0)
        if not self.result:
            raise InvalidValueError("result=[] names nothing to report: give a folder, e.g. aerial-il report runs/NAME")
        if too_few := [count for count in self.learning_curve if count < 1]:
            raise InvalidValueError(f"learning_curve: {too_few[0]} demonstrations; their number starts at 1.")


def report(settings: Report) -> Path:
    """Write the page, and return where it is.

    Raises:
        InvalidValueError: one of several folders holds no run.
    """
    if flown := [place for place in settings.result if _is_dataset(place)]:
        return _of_session(settings, flown)
    every = _runs(settings)
    if not every:
        return _of_evaluation(settings)
    return _of_run(settings, every[0]) if len(every) == 1 else _of_runs(settings, every)


def rows(settings: Report) -> list[dict[str, str]]:
    """Return numbers for a table: of runs a row for each of their evaluations, of an evaluation one for each metric.

    Raises:
        InvalidValueError: there are neither, or one of several folders holds no run.
    """
    from aerial_il.evaluation.result import load_result

    if flown := [place for place in settings.result if _is_dataset(place)]:
        raise InvalidValueError(f"{flown[0]} is a folder of recordings, of which there is a page alone.")
    if every := _runs(settings):
        return [row for run in every for row in _run_rows(run)]
    result = load_result(settings.result[0])
    numbers = {"success": result.success, **result.metrics}
    means = {name: each.get("mean", each.get("rate")) for name, each in numbers.items() if "ci95" in each}
    return [_number(name, mean, numbers[name]["ci95"]) for name, mean in means.items() if mean is not None]


def _number(name: str, mean: float, ci95: tuple[float, float]) -> dict[str, str]:
    return {"number": name, "mean": f"{mean:.4g}", "low": f"{ci95[0]:.4g}", "high": f"{ci95[1]:.4g}"}


def _run_rows(run: TrainingRun) -> list[dict[str, str]]:
    """Return a row for each evaluation in a run's folder; one without success for a run that has none."""
    head = {"run": str(run.path), "algorithm": run.algorithm, "policy": run.policy, "seed": str(run.seed)}
    head["steps"] = str(run.steps)
    results = [
        {"evaluation": name, "tier": each.tier, "episodes": str(len(each.episodes))}
        | {key: f"{value:.4g}" for key, value in zip(RATES, (each.success["rate"], *each.success["ci95"]), strict=True)}
        for name, each in run.judged.items()
    ]
    nothing = dict.fromkeys(("evaluation", "tier", "episodes", *RATES), "")
    return [head | each for each in results or [nothing]]


def _runs(settings: Report) -> list[TrainingRun]:
    """Return the runs in all places; none where the only place is an evaluation's."""
    from aerial_il.evaluation.training_run import find_runs, read_run

    runs = {place: [read_run(folder) for folder in find_runs(place)] for place in settings.result}
    if len(runs) > 1 and (lacking := [place for place, each in runs.items() if not each]):
        why = (
            "holds no training run; evaluations are reported one at a time, and ranked by aerial-il compare"
            if Path(lacking[0]).exists()
            else "does not exist"
        )
        raise InvalidValueError(f"{lacking[0]} {why}. To see what runs there are: aerial-il runs FOLDER")
    return [run for each in runs.values() for run in each]


def _is_dataset(place: str) -> bool:
    from aerial_il.data.folder import KINDS, DatasetFolder

    return Path(place).is_dir() and any(DatasetFolder(place).files(kind) for kind in KINDS)


def _of_session(settings: Report, flown: list[str]) -> Path:
    from aerial_il.workflows.parts.sessions import write_summary

    if len(settings.result) > 1:
        raise InvalidValueError(f"{flown[0]} is a folder of recordings: report it alone.")
    return write_summary(flown[0], settings.out)


def _of_evaluation(settings: Report) -> Path:
    from aerial_il.evaluation.result import load_result
    from aerial_il.presentation.pages.report import write_report
    from aerial_il.workflows.parts import results

    folder = Path(settings.result[0])
    folder = folder if folder.is_dir() else folder.parent
    result = load_result(settings.result[0])
    return write_report(
        settings.out or folder / PAGE,
        result,
        footage=results.footage_of(folder, result),
        run=settings.run,
        dataset=results.summary_of(settings.dataset) if settings.dataset else None,
        learning_curve=_curve(settings.learning_curve),
        command=str(result.provenance.get("command", "")),
    )


def _curve(places: Mapping[int, str]) -> list[LearningPoint]:
    """Return the points of a learning curve.

    Raises:
        InvalidValueError: one is of another robot, task or tier than the others.
    """
    from aerial_il.evaluation.curves import LearningPoint
    from aerial_il.evaluation.result import load_result

    points = [LearningPoint(count, load_result(place)) for count, place in places.items()]
    cells = {p.demonstrations: f"{p.result.robot} {p.result.task} {p.result.tier}" for p in points}
    if len({*cells.values()}) > 1:
        said = ", ".join(f"{count}: {cell}" for count, cell in cells.items())
        raise InvalidValueError(f"learning_curve: its evaluations are not of one robot, task and tier ({said}).")
    return points


def _of_run(settings: Report, run: TrainingRun) -> Path:
    from aerial_il.presentation.pages.run_report import write_run_report
    from aerial_il.workflows.parts import run_results

    predictions, note = run_results.predictions(run, settings.dataset)
    rewarded = run_results.rewarded(run, settings.dataset)
    others = run_results.flown_by_others(run)
    films = run_results.footage(run, settings.videos, settings.progress, others=others)
    return write_run_report(
        settings.out or run.path / PAGE,
        run,
        predictions=predictions,
        prediction_note=note,
        rewarded=rewarded,
        footage=films,
        flown_by_others=others,
    )


def _of_runs(settings: Report, runs: list[TrainingRun]) -> Path:
    from aerial_il.presentation.pages.run_report import write_runs_report

    together = os.path.commonpath([run.path.resolve().parent for run in runs])
    return write_runs_report(settings.out or Path(together) / PAGE, runs)
