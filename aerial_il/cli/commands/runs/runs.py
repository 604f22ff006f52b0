"""List the training runs and evaluations below a folder; filter, sort, compare and prune the runs.

Of runs it says what they differ in and how far they came, of evaluations success with its 95 % interval; where= leaves
the evaluations in the folders of the runs that it chooses.

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

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from aerial_il.cli.as_json import AsJson
from aerial_il.cli.tables import fitting, table
from aerial_il.core.errors import InvalidValueError
from aerial_il.workflows.runs import Listed, Runs, runs

if TYPE_CHECKING:
    from aerial_il.evaluation.run_collection import RunCollection

MOST_COMPARED = 8  # side by side
KEPT = ("run", "state", "success", "algorithm", "policy")  # columns that are left out last


@dataclass(frozen=True, kw_only=True)
class Shown(AsJson, Runs):
    """How they are shown.

    Attributes:
        columns: columns beside the name ([]: state, axes and results, as many as fit).
        compare: a column for each run, a line for each setting or result in which they differ.
    """

    columns: tuple[str, ...] = ()
    compare: bool = False


SETTINGS, BARE = Shown, ("folder",)


def run(settings: Shown) -> None:
    """Print what was asked for."""
    listed = runs(settings)
    as_text = partial(_compared, listed.runs) if settings.compare else partial(_listing, listed, settings.columns)
    settings.show(_plain(listed), as_text)
    if not settings.json:
        _warn(listed.runs)
    if listed.page is not None:
        print(f"Report: {listed.page}")
    for line in listed.pruned:
        print(line)


def _listing(listed: Listed, columns: Sequence[str]) -> str:
    """Return the table of runs, and that of evaluations unless columns of runs were asked for."""
    evaluations = [] if columns else [table(list(map(_evaluation, listed.evaluations)))] * bool(listed.evaluations)
    runs = [_runs(listed.runs, columns)] * bool(listed.runs.runs or not evaluations)
    return "\n\n".join([*runs, *evaluations])


def _runs(collection: RunCollection, columns: Sequence[str]) -> str:
    rows = _shown(collection, columns)
    if columns:
        return table(rows)
    kept, left_out = fitting(rows, KEPT)
    note = (
        f"\n  and {len(left_out)} columns more: columns=[{left_out[0]},...], compare=true or --json" if left_out else ""
    )
    return table(kept) + note


def _evaluation(row: Mapping[str, Any]) -> dict[str, Any]:
    low, high = (f"{100 * end:.1f}" for end in row["ci95"])
    return {**row, "success": f"{100 * row['success']:.1f} %", "ci95": f"{low} to {high} %"}


def _plain(listed: Listed) -> dict[str, Any]:
    refused = {str(place): why for place, why in listed.runs.refused.items()}
    runs = {"runs": listed.runs.rows, "axes": listed.runs.axes}
    return {**runs, "evaluations": list(listed.evaluations), "refused": refused}


def _shown(collection: RunCollection, columns: Sequence[str]) -> list[dict[str, Any]]:
    """Return the table's rows, numbers shortened; columns that no run fills are left out."""
    from aerial_il.evaluation.run_collection import settings_of

    rows = collection.rows
    if columns:
        rows = [
            {"run": row["run"], **{name: {**settings_of(run), **row}.get(name) for name in columns}}
            for run, row in zip(collection.runs, rows, strict=True)
        ]
    filled = [name for name in rows[0] if any(row[name] is not None for row in rows)] if rows else []
    return [{name: _short(row[name]) for name in filled} for row in rows]


def _compared(collection: RunCollection) -> str:
    if not 2 <= len(collection.runs) <= MOST_COMPARED:
        raise InvalidValueError(
            f"compare=true compares 2 to {MOST_COMPARED} runs, and {len(collection.runs)} match: "
            "choose them with where=."
        )
    rows = [{name: _short(value) for name, value in row.items()} for row in collection.rows]
    differing = [name for name in rows[0] if name != "run" and len({repr(row[name]) for row in rows}) > 1]
    return table([{"": name, **{str(row["run"]): row[name] for row in rows}} for name in differing])


def _short(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.4g}")
    return [_short(inner) for inner in value] if isinstance(value, list) else value


def _warn(collection: RunCollection) -> None:
    for place, why in collection.refused.items():
        logging.getLogger(__name__).warning("%s: %s.", place, why.rstrip("."))
