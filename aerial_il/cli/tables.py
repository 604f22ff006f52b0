"""Plain tables for a terminal."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from typing import Any


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Lay rows out in columns under their keys; numbers stand to the right, lists are joined by commas."""
    if not rows:
        return "  (none)"
    names = list(rows[0])
    cells = [[name.replace("_", " ") for name in names]] + [[_text(row[name]) for name in names] for row in rows]
    widths = [max(len(line[i]) for line in cells) for i in range(len(names))]
    numeric = [isinstance(rows[0][name], (int, float)) and not isinstance(rows[0][name], bool) for name in names]
    forms = [f"{'>' if right else '<'}{width}" for right, width in zip(numeric, widths, strict=True)]
    lines = ["  ".join(map(format, line, forms)) for line in cells]
    rule = "  ".join("-" * width for width in widths)
    return "\n".join(f"  {line}".rstrip() for line in [lines[0], rule, *lines[1:]])


def fitting(rows: Sequence[Mapping[str, Any]], kept: Sequence[str]) -> tuple[list[dict[str, Any]], list[str]]:
    """Return rows with as many columns as a terminal has room for, and the names of those that are left out.

    Args:
        rows: all with the same keys. kept: columns that go last, in this order; of the others, the widest go first.
    """
    if not rows:
        return [], []
    room = shutil.get_terminal_size((120, 24)).columns
    widths = {name: max(len(name), *(len(_text(row[name])) for row in rows)) + 2 for name in rows[0]}
    others = sorted((name for name in widths if name not in kept), key=lambda name: -widths[name])
    order, gone = [*others, *reversed([name for name in kept if name in widths])], list[str]()
    while sum(widths[name] for name in widths if name not in gone) > room and len(gone) < len(order) - 1:
        gone.append(order[len(gone)])
    return [{name: row[name] for name in widths if name not in gone} for row in rows], gone


def _text(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return ", ".join(map(str, value))
    return "-" if value is None else str(value)
