"""Run one study, or all of them: what was measured, against which targets, on what machine.

Each folder of experiments/ with a study.py is one. They are run from a checkout. Killed at any moment, the same command
continues; what is finished is not done again. With save=true the result becomes the study's page. With quick=true a
small version of every headline claim is flown, in half an hour, and the exit status is 1 if one no longer holds.

Example: aerial-il bench tracking bench.seeds=4
Example: aerial-il bench speed bench.robots=[ua_quad_arm4] save=true
Example: aerial-il bench quick=true
"""

import shutil
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

from aerial_il.cli.as_json import AsJson
from aerial_il.cli.tables import table
from aerial_il.core import registry
from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.core.schema import Choice
from aerial_il.workflows.spelling import command_line, words_of

EXPERIMENTS = "experiments"


class ClaimError(AerialError):
    """A headline claim no longer holds."""

    status = 1


@dataclass(frozen=True, kw_only=True)
class Bench(AsJson):
    """What is measured.

    Attributes:
        bench: which study (null: all, one after the other).
        out: folder for report.json and figures, one below it for each study.
        save: also write the study's page in experiments/.
        again: forget what is finished, and do all anew.
        quick: fly a small version of the headline claims, and say which hold.
        progress: show progress bars.
    """

    bench: Annotated[Any, Choice("study")] | None = None
    out: str = "runs/benchmarks"
    save: bool = False
    again: bool = False
    quick: bool = False
    progress: bool = True


SETTINGS, BARE, OUTPUT = Bench, ("bench",), "out"


def run(settings: Bench) -> None:
    """Measure, keep the report, print it.

    Raises:
        InvalidValueError: this is an installed package, which has no studies; or settings are tried out on seeds that
            are reserved for judging. ClaimError: a claim does not hold.
    """
    if not registry.names("study"):
        raise InvalidValueError(registry.KINDS["study"].hint)
    studies = [settings.bench] if settings.bench else [registry.get("study", n)() for n in registry.names("study")]
    if settings.quick:
        _check_claims(tuple(study.name for study in studies), settings)
        return
    seeds = import_module(f"{EXPERIMENTS}.common.seeds")
    for study in studies:
        seeds.check_distinct(study)
        seeds.check_untuned(study)
    reports = [_measure(study, settings) for study in studies]
    plain = [report.to_dict() for report in reports]
    settings.show(plain[0] if settings.bench else plain, lambda: "\n\n".join(map(as_text, reports)))


def as_text(report: Any) -> str:
    """Lay a report out for a terminal."""
    targets = [f"{report.verdict}\n{table([t.to_row() for t in report.targets])}"] if report.targets else []
    tables = [f"{title}\n{table(rows)}" for title, rows in report.tables.items()]
    return "\n\n".join([f"{report.study.name}: {report.study.question}", *targets, *tables, *report.notes])


def rerun(study: Any) -> str:
    """Return what measures it again: the study and the settings that differ from its own."""
    _, *changed = words_of(Bench(bench=study))
    return command_line(["bench", study.name, *changed, "save=true"])


def _measure(study: Any, settings: Bench) -> Any:
    from aerial_il.core.files import write_atomic, write_json

    folder = Path(settings.out) / study.name
    if settings.again:
        shutil.rmtree(folder, ignore_errors=True)
    report = study.run(folder, progress=settings.progress)
    write_json(folder / "report.json", report.to_dict())
    for name, svg in report.figures.items():
        write_atomic(folder / name, svg)
    if settings.save:  # nothing of the package imports studies
        import_module(f"{EXPERIMENTS}.common.page").save_study(report, Path(EXPERIMENTS), command=rerun(study))
    return report


def _check_claims(names: tuple[str, ...], settings: Bench) -> None:
    claims = import_module(f"{EXPERIMENTS}.common.claims")
    folder = Path(settings.out) / "quick"
    if settings.again:
        shutil.rmtree(folder, ignore_errors=True)
    rows = claims.checked(names, folder, progress=settings.progress)
    settings.show(rows, lambda: table(rows))
    if broken := [row["claim"] for row in rows if row["verdict"] == claims.BROKEN]:
        raise ClaimError(f"{len(broken)} of {len(rows)} claims do not hold: {'; '.join(broken)}.")
