"""Run one benchmark, or all of them: what was measured, against which targets, on what machine.

Each file of conf/bench/ is one. Killed at any moment, the same command continues. With save=true the result becomes a
study in experiments/, with a page of its own and a place in experiments/benchmarks.md.

Example: aerial-il bench tracking bench.seeds=4
Example: aerial-il bench speed bench.robots=[ua_quad_arm4] save=true
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aerial_il.cli.configuration import groups, spelling
from aerial_il.cli.configuration.build import build
from aerial_il.cli.configuration.keys import group, key, output
from aerial_il.cli.configuration.quoting import command_line
from aerial_il.cli.tables import table

if TYPE_CHECKING:
    from aerial_il.benchmarks.parts.reporting.report import Report

EXPERIMENTS = "experiments"


@dataclass
class Config:
    bench: dict[str, Any] | None = group("which benchmark (null: all, one after the other)", position=0)
    out: str = output("runs/benchmarks", "folder for report.json and figures, one below it for each benchmark")
    save: bool = key(False, f"also write the study to {EXPERIMENTS}/")
    json: bool = key(False, "print one JSON object (also: --json)")
    progress: bool = key(True, "show progress bars")


def run(config: Config) -> None:
    """Measure, keep the report, print it."""
    chosen = (
        [config.bench]
        if config.bench is not None
        else [groups.read_option("bench", n) for n in groups.options("bench")]
    )
    reports = [_measure(settings, config) for settings in chosen]
    if config.json:
        found = [report.to_dict() for report in reports]
        print(json.dumps(found[0] if config.bench is not None else found, indent=2))
    else:
        print("\n\n".join(map(as_text, reports)))


def as_text(report: Report) -> str:
    """Lay a report out for a terminal."""
    targets = [f"{report.verdict}\n{table([t.to_row() for t in report.targets])}"] if report.targets else []
    tables = [f"{title}\n{table(rows)}" for title, rows in report.tables.items()]
    return "\n\n".join([f"{report.name}: {report.question}", *targets, *tables, *report.notes])


def _measure(settings: Mapping[str, Any], config: Config) -> Report:
    from aerial_il.benchmarks.parts.reporting.study import save_study
    from aerial_il.core.files import write_atomic, write_json

    benchmark = build(settings)
    folder = Path(config.out) / benchmark.name
    report = benchmark.run(folder, progress=config.progress)
    write_json(folder / "report.json", report.to_dict())
    for name, svg in report.figures.items():
        write_atomic(folder / name, svg)
    if config.save:
        save_study(report, Path(EXPERIMENTS), command=rerun(benchmark.name, settings))
    return report


def rerun(name: str, settings: Mapping[str, Any]) -> str:
    """Return what measures it again: the benchmark and the settings that differ from its file."""
    changed = spelling.changed("bench", groups.read_option("bench", name), settings)
    return command_line(["bench", name, *changed, "save=true"])
