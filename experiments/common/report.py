"""What a study is, and its report: tables, targets met or missed, figures, and where they come from."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.progress import Progress
from aerial_il.core.provenance import provenance
from aerial_il.suite.physics.thread_pool import available_cores
from experiments.common.plain import plain

Row = dict[str, Any]
Details = dict[str, Any]
SCHEMA = "aerial_il.benchmark/1"


class Study(Protocol):
    """A question with a way to answer it. Implementations are frozen dataclasses whose fields are the settings.

    Attributes:
        name: that of its folder. question: what it answers, in one sentence.
    """

    name: ClassVar[str]
    question: ClassVar[str]

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Measure.

        Args:
            folder: for what must survive a kill; the same call on the same folder continues.
            progress: show progress bars.
        """
        ...


@dataclass(frozen=True)
class Target:
    """A number to reach and what was measured.

    Attributes:
        what: the quantity. sense: whether ``limit`` is a floor or a ceiling. limit: the number to reach.
        measured: the number found. unit: of both. spread: how sure the measured one is, in words for people.
    """

    what: str
    sense: Literal["at least", "at most"]
    limit: float
    measured: float
    unit: str = ""
    spread: str = ""

    @property
    def met(self) -> bool:
        return self.measured >= self.limit if self.sense == "at least" else self.measured <= self.limit

    def to_dict(self) -> dict[str, Any]:
        return {**asdict(self), "met": self.met}

    def to_row(self) -> Row:
        """Return it as a row of a table for people."""
        unit = f" {self.unit}" if self.unit else ""
        return {
            "target": self.what,
            "wanted": f"{self.sense} {self.limit:g}{unit}",
            "measured": f"{self.measured:.3g}{unit}",
            "spread": self.spread,
            "verdict": "met" if self.met else "not met",
        }


@dataclass(frozen=True, kw_only=True)
class Report:
    """The answer of a study.

    Attributes:
        study: whose question it answers, with the settings by which.
        targets: numbers to reach. tables: title -> rows; the first one is the summary.
        notes: how it was measured, one sentence each. figures: file name -> SVG.
        details: everything measured, as plain values, down to single seeds or repetitions.
        wall_time_s: how long it took. machine: where. provenance: code and packages.
    """

    study: Study
    tables: Mapping[str, Sequence[Row]]
    targets: Sequence[Target] = ()
    notes: Sequence[str] = ()
    figures: Mapping[str, str] = field(default_factory=dict, repr=False)
    details: Details = field(default_factory=dict, repr=False)
    wall_time_s: float = 0.0
    machine: Mapping[str, Any] = field(default_factory=lambda: machine())
    provenance: Mapping[str, Any] = field(default_factory=provenance)

    def __post_init__(self) -> None:
        if not self.tables:
            raise InvalidValueError(f"The report of {self.study.name!r} has no table.")

    @property
    def verdict(self) -> str:
        """The number of targets that are met, in words."""
        met = sum(target.met for target in self.targets)
        return f"{met} of {len(self.targets)} targets met" if self.targets else "no targets"

    def to_dict(self) -> dict[str, Any]:
        """Return everything but the figures as plain values ready for JSON."""
        return {
            "schema": SCHEMA,
            "benchmark": self.study.name,
            "question": self.study.question,
            "verdict": self.verdict,
            "settings": settings_of(self.study),
            "targets": [target.to_dict() for target in self.targets],
            "tables": {title: list(rows) for title, rows in self.tables.items()},
            "notes": list(self.notes),
            "details": self.details,
            "wall_time_s": round(self.wall_time_s, 1),
            "machine": dict(self.machine),
            "provenance": dict(self.provenance),
        }


def settings_of(study: Study) -> dict[str, Any]:
    """Return the settings of a study as JSON gives them back, nested ones with the names of their classes."""
    return json.loads(json.dumps(plain(study)))


def skipped(study: Study, why: str) -> Report:
    """Return the report of a study that measured nothing, and says why."""
    return Report(study=study, tables={"Skipped": [{"why": why}]}, notes=(why,))


def bar[T](items: Iterable[T], name: str, progress: bool) -> Iterable[T]:
    """Iterate over ``items`` with a progress bar on stderr, or without one."""
    return Progress(items, desc=f"bench {name}", unit="arm", disable=not progress)


def machine() -> dict[str, Any]:
    """Return what speed depends on: processor, cores available to this process, load at this moment."""
    return {"cpu": _cpu_name(), "cores": available_cores(), "load_average": round(os.getloadavg()[0], 1)}


def _cpu_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), platform.machine())
