"""Choose episodes by a condition on their rows in the table, or on their provenance."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from aerial_il.core.errors import DemoError, InvalidValueError, UnknownNameError
from aerial_il.core.progress import Progress
from aerial_il.data.curation.where import Where
from aerial_il.data.dataset import Dataset
from aerial_il.data.recording.reader import read_origin
from aerial_il.data.table import Row, read_table


def select(dataset: Dataset, where: str, *, progress: bool = False) -> list[Row]:
    """Return the rows of the episodes for which a condition holds, at least one.

    Args:
        dataset: opened with ``failures=True``. where: see :mod:`.where`. progress: show a bar while files are read.

    Raises:
        UnknownNameError: it asks for a column that there is not.
        InvalidValueError: it is no condition, or holds for none; says of how many each of its clauses does.
    """
    condition = Where.parse(where)
    rows = read_table(dataset, progress=progress)
    if not rows:
        raise InvalidValueError(f"{dataset.path} has no episode that can be read.")
    _require(condition, dataset, rows)
    clauses, needs_origin = condition.clauses, bool(condition.mappings or condition.names - rows[0].keys())
    chosen, counts = list[Row](), [0] * len(clauses)
    for row in Progress(rows, desc="select", unit="ep", disable=not progress):
        origin = _origin(dataset, row["uid"]) if needs_origin else {}
        held = [clause.holds(row, origin) for clause in clauses]
        counts = [count + holds for count, holds in zip(counts, held, strict=True)]
        if all(held):
            chosen.append(row)
    if not chosen:
        said = "; ".join(f"{clause.text}: {count}" for clause, count in zip(clauses, counts, strict=True))
        raise InvalidValueError(f"where={where} holds for none of {len(rows)} episodes in {dataset.path} ({said}).")
    return chosen


def named(dataset: Dataset, uids: Collection[str]) -> list[Row]:
    """Return the rows of the episodes of these names, at least one.

    Raises:
        DemoError: the dataset has no such episode. InvalidValueError: none is named.
    """
    if not uids:
        raise InvalidValueError("No episode is marked.")
    if unknown := sorted({*uids} - {*dataset.uids}):
        hint = f"List them with: aerial-il info path={dataset.path}"
        raise DemoError(dataset.path, f"has no episode {unknown[0]!r}.", hint=hint)
    wanted = {*uids}
    return [row for row in read_table(dataset) if row["uid"] in wanted]


def _origin(dataset: Dataset, uid: str) -> Mapping[str, Any]:
    """Return the provenance of an episode, with a note even where it has none."""
    file = dataset.files.get(uid)
    return {"note": "", **(dataset[uid].provenance if file is None else read_origin(file))}


def _require(condition: Where, dataset: Dataset, rows: Sequence[Row]) -> None:
    """Refuse names that no episode knows, neither in the table nor in its provenance."""
    known: dict[str, Any] = {}
    for row in rows:
        known |= {name: value for name, value in _origin(dataset, row["uid"]).items() if value is not None}
        try:
            condition.require(row, known)
        except UnknownNameError:
            continue
        return
    condition.require(rows[0], known)
