"""A page on which thousands of episodes are looked through: a scatter plot with a brush, a table, marks, edits."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from aerial_il.presentation.pages.page import page_text, write_page

FIRST = ("uid", "success", "failure", "phase", "seconds", "return", "seed", "operator", "tag")  # of the columns


def write_browse_page(path: str | os.PathLike[str], dataset: str, rows: Sequence[Mapping[str, Any]]) -> Path:
    """Write the page as a file, on which marks become a command to type.

    Args:
        path: destination, an HTML file. dataset: as it is typed. rows: its table.
    """
    return write_page(path, "browse.html.j2", **_values(dataset, rows, served=False))


def browse_page(dataset: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the page as a server hands it out, which then makes edits and films."""
    return page_text("browse.html.j2", **_values(dataset, rows, served=True))


def table_of(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return rows as the page's script reads them: names of the columns, and the values of each row."""
    names = [*FIRST, *(name for name in (rows[0] if rows else ()) if name not in FIRST)]
    telling = [name for name in names if name in FIRST[:6] or len({str(row.get(name)) for row in rows}) > 1]
    return {"columns": telling, "rows": [[_plain(row.get(name)) for name in telling] for row in rows]}


def _values(dataset: str, rows: Sequence[Mapping[str, Any]], *, served: bool) -> dict[str, Any]:
    return {"dataset": dataset, "data": {"dataset": dataset, "served": served, **table_of(rows)}}


def _plain(value: Any) -> Any:
    return value if isinstance(value, (bool, int, float, str, type(None))) else str(value)
