"""Tables for people: a number and its interval share a cell. The numbers of a study keep every column."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from experiments.common.report import Row

INTERVALS: Mapping[str, tuple[tuple[str, str, str], ...]] = {  # number -> its interval: what it is called, its ends
    "percent": (("flights", "flights_low", "flights_high"), ("95 %", "ci95_low", "ci95_high")),
    "return": (("95 %", "low", "high"),),
    "difference": (("95 %", "low", "high"),),
    "steps_per_s": (("slowest–fastest", "slowest", "fastest"),),
}
COUNTS = ("flights", "trainings")  # columns whose names are also those of intervals of something else
PAIRS = {  # columns that follow each other: title, and how they are written
    ("success", "episodes"): ("success", "{}/{}"),
    ("worst", "best"): ("worst–best", "{}–{}"),
}
VALUE, BETWEEN = r"-?[\d.]+(e[-+]\d+)?", "(–| to )"
NUMBER = re.compile(rf"{VALUE}(/\d+|{BETWEEN}{VALUE}| \({VALUE}{BETWEEN}{VALUE}\))?")


@dataclass(frozen=True)
class Column:
    """What people see in one column.

    Attributes:
        title: of it. names: the columns of a row that share it. form: how two or three values are written.
    """

    title: str
    names: tuple[str, ...]
    form: str = "{}"

    def cell(self, row: Row) -> str:
        """Return its text; of a number without an interval the number alone."""
        first, *others = (row[name] for name in self.names)
        if first is None:
            return ""
        if None in others:
            return str(first)
        form = self.form.replace("–", " to ") if any(_is_negative(value) for value in others) else self.form
        return form.format(first, *others)


def markdown(rows: Sequence[Row]) -> str:
    """Lay rows out as a Markdown table; numbers stand to the right."""
    columns = list(columns_of(rows[0]))
    cells = [[column.cell(row) for column in columns] for row in rows]
    numeric = [all(not cell or NUMBER.fullmatch(cell) for cell in column) for column in zip(*cells, strict=True)]
    lines = [[column.title for column in columns], ["---:" if right else "---" for right in numeric], *cells]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def columns_of(row: Row) -> Iterator[Column]:
    """Yield the columns of a table of rows like this one."""
    found = {column.names[0]: column for column in _shared(row)}
    taken = {name for column in found.values() for name in column.names}
    for name in row:
        if name in found:
            yield found[name]
        elif name not in taken:
            yield Column(_title(name), (name,))


def _shared(row: Row) -> Iterator[Column]:
    """Yield the columns that several of a row's share: numbers with their intervals, intervals alone, and pairs."""
    free = {name.removesuffix("_low") for name in row if name.endswith("_low")}
    for name in row:
        own = () if name in COUNTS else (("95 %", f"{name}_low", f"{name}_high"),)
        for called, *ends in (*INTERVALS.get(name, ()), *own):
            if set(ends) <= row.keys():
                free.discard(ends[0].removesuffix("_low"))
                yield Column(f"{_title(name)} ({called})", (name, *ends), "{} ({}–{})")
    yield from (Column(f"{_title(name)} interval", (f"{name}_low", f"{name}_high"), "{}–{}") for name in free)
    for pair in pairwise(row):
        if pair in PAIRS:
            title, form = PAIRS[pair]
            yield Column(title, pair, form)


def _title(name: str) -> str:
    return name.replace("_", " ")


def _is_negative(value: object) -> bool:
    return isinstance(value, int | float) and value < 0
