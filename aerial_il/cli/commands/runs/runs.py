"""List the training runs below a folder: what they differ in, how far they came; filter, sort, compare and prune them.

A condition is a column or a setting, a sign (= != < <= > >=, ~ for a pattern) and a value; commas part several,
which must all hold. Folders that are no runs, or cannot be read, are named with the reason, and the others are listed.

page=true writes a page of them: every axis of the sweep, curves and the table. prune=trash moves the runs that where=
leaves into FOLDER/trash, prune=delete removes them; a run that is being trained is left alone.

Example: aerial-il runs runs/sweep sort=-success
Example: aerial-il runs runs where=algorithm.lr=0.001,success>0.5 columns=[success,steps]
Example: aerial-il runs runs/sweep where=run~seed=0* compare=true
Example: aerial-il runs runs where=state!=finished prune=trash
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aerial_il.cli.configuration.keys import key
from aerial_il.cli.configuration.quoting import parts
from aerial_il.cli.tables import table

if TYPE_CHECKING:
    from aerial_il.evaluation.run_collection import RunCollection

PAGE = "report.html"
MOST_COMPARED = 8  # side by side


@dataclass
class Config:
    folder: str = key("runs", "folder to search, at any depth", position=0)
    where: str | None = key(None, "conditions that all must hold, e.g. 'success>0.5,policy.name=mlp'")
    sort: str | None = key(None, "column or setting to sort by; -success for the best first (null: by name)")
    columns: list[str] = key([], "columns beside the name ([]: state, axes and results)", many=True)
    compare: bool = key(False, "a column for each run, a line for each setting or result in which they differ")
    page: bool = key(False, f"write {PAGE} into the folder: axes, curves, table")
    prune: str | None = key(None, "trash or delete: what happens to the runs that where= selects")
    json: bool = key(False, "print one JSON object (also: --json)")

    def __post_init__(self) -> None:
        from aerial_il.core.errors import InvalidValueError

        if self.prune not in (None, "trash", "delete"):
            raise InvalidValueError(f"prune={self.prune} is not one of trash, delete.")
        if self.prune and not self.where:
            raise InvalidValueError("prune= needs where=, the runs to remove, e.g. where='state!=finished'.")


def run(config: Config) -> None:
    """Print what was asked for."""
    from aerial_il.evaluation.run_collection import read_runs

    found = read_runs(config.folder)
    found = found.where(parts(config.where)) if config.where else found
    found = found.sorted_by(config.sort) if config.sort else found
    if config.json:
        print(json.dumps(_as_json(found), indent=2))
    else:
        print(_compared(found) if config.compare else table(_shown(found, config.columns)))
        _warn(found)
    if config.page:
        print(f"Report: {_write_page(found)}")
    if config.prune:
        _prune(config, found)


def _as_json(found: RunCollection) -> dict[str, Any]:
    refused = {str(place): why for place, why in found.refused.items()}
    return {"runs": found.rows, "axes": found.axes, "refused": refused}


def _shown(found: RunCollection, columns: list[str]) -> list[dict[str, Any]]:
    """Return the table's rows, numbers shortened; columns that no run fills are left out."""
    from aerial_il.evaluation.run_collection import settings_of

    rows = found.rows
    if columns:
        rows = [
            {"run": row["run"], **{name: {**settings_of(run), **row}.get(name) for name in columns}}
            for run, row in zip(found.runs, rows, strict=True)
        ]
    filled = [name for name in rows[0] if any(row[name] is not None for row in rows)] if rows else []
    return [{name: _short(row[name]) for name in filled} for row in rows]


def _compared(found: RunCollection) -> str:
    from aerial_il.core.errors import InvalidValueError

    if not 2 <= len(found.runs) <= MOST_COMPARED:
        raise InvalidValueError(
            f"compare=true compares 2 to {MOST_COMPARED} runs, and {len(found.runs)} match: choose them with where=."
        )
    rows = [{name: _short(value) for name, value in row.items()} for row in found.rows]
    differing = [name for name in rows[0] if name != "run" and len({repr(row[name]) for row in rows}) > 1]
    return table([{"": name, **{str(row["run"]): _text(row[name]) for row in rows}} for name in differing])


def _short(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.4g}")
    return [_short(inner) for inner in value] if isinstance(value, list) else value


def _text(value: Any) -> str:
    return "-" if value is None else str(value)


def _warn(found: RunCollection) -> None:
    import logging

    for place, why in found.refused.items():
        logging.getLogger(__name__).warning("%s: %s.", place, why.rstrip("."))


def _write_page(found: RunCollection) -> Path:
    from aerial_il.core.errors import InvalidValueError
    from aerial_il.presentation.pages.run_report import write_runs_report

    if not found.runs:
        raise InvalidValueError(f"{found.folder} has no such run, so there is no page to write.")
    return write_runs_report(found.folder / PAGE, found.runs, refused=found.refused)


def _prune(config: Config, found: RunCollection) -> None:
    """Move or remove the runs that were listed, one by one, and say so."""
    from aerial_il.workflows.parts.pruning import prune

    for listed in found.runs:
        print(prune(listed, found.folder, delete=config.prune == "delete"))
