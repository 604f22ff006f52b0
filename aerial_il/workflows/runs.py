"""The training runs and evaluations below a folder: read, filtered, sorted, drawn on a page, and put away."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.workflows.spelling import parts

if TYPE_CHECKING:
    from aerial_il.evaluation.result import EvaluationResult
    from aerial_il.evaluation.run_collection import RunCollection

PAGE = "report.html"


@dataclass(frozen=True, kw_only=True)
class Runs:
    """Which runs, and what becomes of them.

    Attributes:
        folder: folder to search, at any depth.
        where: conditions that all must hold, e.g. 'success>0.5,policy.name=mlp'.
        sort: column or setting to sort by; -success for the best first (null: by name).
        page: write report.html into the folder: axes, curves, table.
        prune: trash or delete: what happens to the runs that where= selects.
    """

    folder: str = "runs"
    where: str | None = None
    sort: str | None = None
    page: bool = False
    prune: Literal["trash", "delete"] | None = None

    def __post_init__(self) -> None:
        if self.prune and not self.where:
            raise InvalidValueError("prune= needs where=, the runs to remove, e.g. where='state!=finished'.")


@dataclass(frozen=True)
class Listed:
    """The runs that were chosen, rows of evaluations, the page if one was written, and what was put away."""

    runs: RunCollection
    evaluations: tuple[dict[str, Any], ...]
    page: Path | None
    pruned: tuple[str, ...]


def runs(settings: Runs) -> Listed:
    """Read and choose; then write the page and put away what is to go.

    Of the evaluations, ``where`` leaves those in the folders of the runs that it chooses.
    """
    from aerial_il.evaluation.run_collection import read_runs
    from aerial_il.workflows.parts.pruning import prune

    collection, evaluations = _with_evaluations(read_runs(settings.folder))
    found = len(collection.runs)
    if settings.where:
        collection = collection.where(parts(settings.where))
        chosen = {run.path for run in collection.runs}
        evaluations = {place: row for place, row in evaluations.items() if not chosen.isdisjoint(place.parents)}
    collection = collection.sorted_by(settings.sort) if settings.sort else collection
    page = _page(collection, found, settings.where) if settings.page else None
    delete = settings.prune == "delete"
    gone = [prune(run, collection.folder, delete=delete) for run in collection.runs] if settings.prune else []
    return Listed(collection, tuple(evaluations.values()), page, tuple(gone))


def _with_evaluations(collection: RunCollection) -> tuple[RunCollection, dict[Path, dict[str, Any]]]:
    """Return folder -> row of the evaluation in it, and the runs, whose folder is no longer refused for having none."""
    from aerial_il.evaluation.result import find_results, load_result
    from aerial_il.evaluation.run_collection import NO_RUN

    rows, refused = dict[Path, dict[str, Any]](), dict[Path, str]()
    for place in find_results(collection.folder):
        try:
            rows[place] = _row(os.path.relpath(place, collection.folder), load_result(place))
        except AerialError as error:
            refused[place] = str(error)
    holding = {each for place in (*rows, *refused) for each in (place, *place.parents)}
    known = {place: why for place, why in collection.refused.items() if why != NO_RUN or place not in holding}
    return replace(collection, refused={**refused, **known}), rows


def _row(name: str, result: EvaluationResult) -> dict[str, Any]:
    said = {key: getattr(result, key) for key in ("policy", "robot", "task", "tier")}
    success = {"success": result.success["rate"], "ci95": list(result.success["ci95"])}
    return {"evaluation": name, **said, **success, "episodes": len(result.episodes)}


def _page(collection: RunCollection, found: int, where: str | None) -> Path:
    from aerial_il.presentation.pages.run_report import write_runs_report

    if not collection.runs:
        raise InvalidValueError(f"{collection.folder} has no such run, so there is no page to write.")
    chosen = f"Chosen of {found} runs: {where}. What is chosen by its success looks better than it is." if where else ""
    return write_runs_report(collection.folder / PAGE, collection.runs, refused=collection.refused, chosen=chosen)
