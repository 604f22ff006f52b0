"""Plain tables: as wide as a terminal, or whole where there is none; and as CSV or LaTeX, for a paper."""

from __future__ import annotations

import csv
import io
import shutil
import textwrap
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aerial_il.evaluation.ranking import Ranking

LATEX = {sign: f"\\{sign}" for sign in "&%_#${}"} | {
    "\\": r"\textbackslash{}", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}",
}  # fmt: skip


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Lay rows out in columns under their keys; numbers stand to the right, lists are joined by commas.

    On a terminal, columns that are too wide for it have their text on several lines.
    """
    if not rows:
        return "  (none)"
    names = list(rows[0])
    cells = [[name.replace("_", " ") for name in names]] + [[_text(row[name]) for name in names] for row in rows]
    widths = _widths(cells)
    numeric = [isinstance(rows[0][name], (int, float)) and not isinstance(rows[0][name], bool) for name in names]
    forms = [f"{'>' if right else '<'}{width}" for right, width in zip(numeric, widths, strict=True)]
    head, *lines = ["\n".join(_lines(line, widths, forms)) for line in cells]
    return "\n".join([head, "  " + "  ".join("-" * width for width in widths), *lines])


def ranked(ranking: Ranking) -> str:
    """Lay a ranking of evaluations out, with how it was compared."""
    return f"{table(ranking.rows())}\n{wrapped(ranking.note)}"


def wrapped(text: str) -> str:
    """Return text with its lines broken where a terminal ends, the rest of each two characters further right."""
    if (room := _room()) is None:
        return text
    indents = (line[: len(line) - len(line.lstrip())] + "  " for line in text.split("\n"))
    pairs = zip(text.split("\n"), indents, strict=True)
    return "\n".join(line if len(line) <= room else textwrap.fill(line, room, subsequent_indent=i) for line, i in pairs)


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


def as_csv(rows: Sequence[Mapping[str, str]]) -> str:
    """Return rows as CSV under their keys."""
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().rstrip()


def as_latex(rows: Sequence[Mapping[str, str]], note: str = "") -> str:
    """Return rows as a table that needs the package booktabs, below a comment."""
    lines = [" & ".join(map(_escaped, row.values())) + r" \\" for row in rows]
    head = " & ".join(map(_escaped, rows[0])) + r" \\"
    inside = [r"\toprule", head, r"\midrule", *lines, r"\bottomrule"]
    comment = [f"% {note}"] if note else []
    return "\n".join([*comment, rf"\begin{{tabular}}{{{'l' * len(rows[0])}}}", *inside, r"\end{tabular}"])


def _room() -> int | None:
    """Return how many characters a line of the terminal has; None where there is none."""
    return shutil.get_terminal_size((0, 0)).columns or None


def _widths(cells: Sequence[Sequence[str]]) -> list[int]:
    """Return widths of columns that fit a terminal together, the widest narrowed alike, as far as words allow."""
    columns = list(zip(*cells, strict=True))
    wanted = [max(map(len, column)) for column in columns]
    words = [max(len(word) for text in column for word in text.split() or [""]) for column in columns]
    room = (_room() or sum(wanted) + 2 * len(wanted)) - 2 * len(wanted)
    for least in (words, [1] * len(words)):
        for most in range(max(wanted), 0, -1):
            widths = [max(min(width, most), low) for width, low in zip(wanted, least, strict=True)]
            if sum(widths) <= room:
                return widths
    return words


def _lines(cells: Sequence[str], widths: Sequence[int], forms: Sequence[str]) -> list[str]:
    parts = [
        textwrap.wrap(text, width, break_on_hyphens=False) if len(text) > width else [text]
        for text, width in zip(cells, widths, strict=True)
    ]
    return [("  " + "  ".join(map(format, line, forms))).rstrip() for line in zip_longest(*parts, fillvalue="")]


def _text(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return ", ".join(map(str, value))
    return "-" if value is None else str(value)


def _escaped(text: str) -> str:
    return "".join(LATEX.get(letter, letter) for letter in text)
