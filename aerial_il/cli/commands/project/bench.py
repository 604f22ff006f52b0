"""Run one study, or all of them: what was measured, against which targets, on what machine.

Each folder of experiments/ with a study.py is one. They are run from a checkout. Killed at any moment, the same command
continues; what is finished is not done again. With save=true the result becomes the study's page. With quick=true a
small version of every headline claim is flown, in half an hour, and the exit status is 1 if one no longer holds.

Example: aerial-il bench tracking bench.seeds=4
Example: aerial-il bench speed bench.robots=[ua_quad_arm4] save=true
Example: aerial-il bench quick=true
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from aerial_il.cli.configuration import groups, spelling
from aerial_il.cli.configuration.keys import group, key, output
from aerial_il.cli.configuration.quoting import command_line
from aerial_il.cli.tables import table
from aerial_il.core import registry
from aerial_il.core.composition import build
from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.core.files import write_atomic, write_json

EXPERIMENTS = "experiments"


class ClaimError(AerialError):
    """A headline claim no longer holds."""

    status = 1


@dataclass
class Config:
    bench: dict[str, Any] | None = group("which study (null: all, one after the other)", position=0)
    out: str = output("runs/benchmarks", "folder for report.json and figures, one below it for each study")
    save: bool = key(False, f"also write the study's page in {EXPERIMENTS}/")
    again: bool = key(False, "forget what is finished, and do all anew")
    quick: bool = key(False, "fly a small version of the headline claims, and say which hold")
    json: bool = key(False, "print one JSON object (also: --json)")
    progress: bool = key(True, "show progress bars")


def check_checkout() -> None:
    """Refuse to go on where there are no studies.

    Raises:
        InvalidValueError: this is an installed package.
    """
    if not registry.names("study"):
        raise InvalidValueError(
            "Studies are run from a checkout, which an installed package is not: clone the repository, run make setup "
            "there, and call .venv/bin/aerial-il bench NAME."
        )


def run(config: Config) -> None:
    """Measure, keep the report, print it."""
    names = registry.names("study") if config.bench is None else (config.bench["name"],)
    if config.quick:
        _check_claims(names, config)
        return
    reports = [_measure(config.bench or groups.read_option("bench", name), config) for name in names]
    if config.json:
        found = [report.to_dict() for report in reports]
        print(json.dumps(found[0] if config.bench is not None else found, indent=2))
    else:
        print("\n\n".join(map(as_text, reports)))


def as_text(report: Any) -> str:
    """Lay a report out for a terminal."""
    targets = [f"{report.verdict}\n{table([t.to_row() for t in report.targets])}"] if report.targets else []
    tables = [f"{title}\n{table(rows)}" for title, rows in report.tables.items()]
    return "\n\n".join([f"{report.study.name}: {report.study.question}", *targets, *tables, *report.notes])


def rerun(settings: Mapping[str, Any]) -> str:
    """Return what measures it again: the study and the settings that differ from its own."""
    name = settings["name"]
    changed = spelling.changed("bench", groups.read_option("bench", name), settings)
    return command_line(["bench", name, *changed, "save=true"])


def _measure(settings: Mapping[str, Any], config: Config) -> Any:
    usual = registry.get("study", settings["name"])()
    study = build(type(usual), {k: v for k, v in settings.items() if k != "name"}, base=usual, at="bench.")
    folder = Path(config.out) / study.name
    if config.again:
        shutil.rmtree(folder, ignore_errors=True)
    report = study.run(folder, progress=config.progress)
    write_json(folder / "report.json", report.to_dict())
    for name, svg in report.figures.items():
        write_atomic(folder / name, svg)
    if config.save:  # nothing of the package imports studies
        import_module(f"{EXPERIMENTS}.common.page").save_study(report, Path(EXPERIMENTS), command=rerun(settings))
    return report


def _check_claims(names: tuple[str, ...], config: Config) -> None:
    claims = import_module(f"{EXPERIMENTS}.common.claims")
    folder = Path(config.out) / "quick"
    if config.again:
        shutil.rmtree(folder, ignore_errors=True)
    rows = claims.checked(names, folder, progress=config.progress)
    print(json.dumps(rows, indent=2) if config.json else table(rows))
    if broken := [row["claim"] for row in rows if row["verdict"] == claims.BROKEN]:
        raise ClaimError(f"{len(broken)} of {len(rows)} claims do not hold: {'; '.join(broken)}.")
