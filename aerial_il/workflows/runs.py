"""The training runs below a folder: read, filtered, sorted, drawn on a page, and put away."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from aerial_il.core.errors import InvalidValueError
from aerial_il.workflows.spelling import parts

if TYPE_CHECKING:
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
    """The runs that were chosen, the page if one was written, and what was put away."""

    runs: RunCollection
    page: Path | None
    pruned: tuple[str, ...]


def runs(settings: Runs) -> Listed:
    """Read and choose; then write the page and put away what is to go."""
    from aerial_il.evaluation.run_collection import read_runs
    from aerial_il.workflows.parts.pruning import prune

    collection = read_runs(settings.folder)
    collection = collection.where(parts(settings.where)) if settings.where else collection
    collection = collection.sorted_by(settings.sort) if settings.sort else collection
    page = _page(collection) if settings.page else None
    delete = settings.prune == "delete"
    gone = [prune(run, collection.folder, delete=delete) for run in collection.runs] if settings.prune else []
    return Listed(collection, page, tuple(gone))


def _page(collection: RunCollection) -> Path:
    from aerial_il.presentation.pages.run_report import write_runs_report

    if not collection.runs:
        raise InvalidValueError(f"{collection.folder} has no such run, so there is no page to write.")
    return write_runs_report(collection.folder / PAGE, collection.runs, refused=collection.refused)
