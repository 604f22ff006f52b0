"""Headline claims, and a small version of each that says in half an hour whether they still hold.

A study's ``claims.yaml`` says which rows of its ``results.json`` are headline figures, and with which settings a small
version of the study measures them again::

    - settings: {draws: [0], episodes: 50}   # that differ from the study's own; null where it cannot be done quickly
      table: Each task
      where: {robot: [fa_hexa_arm4], task: [reach, pick_place]}   # which rows of the table
      named_by: [robot, task]                # columns that name a claim; rows of one name are pooled by their counts
      number: percent
      intervals: [flights, singles]          # columns with its ends, ``flights_low`` and ``flights_high``; of single
                                             # trainings ``worst`` and ``best``, for the small version has one of them
      note: "..."                            # what the small version does differently, or why there is none
      alone: true                            # nothing else may run beside it, as where time is measured

A claim holds where the interval of the small run overlaps the recorded one (of several, what they span together).
"""

from __future__ import annotations

import json
import logging
import os
import resource
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import yaml

from aerial_il.core import registry
from aerial_il.core.composition import build
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_json
from aerial_il.core.provenance import provenance
from aerial_il.evaluation.statistics import wilson
from aerial_il.suite.engine import ENGINE
from experiments.common.page import NUMBERS
from experiments.common.record import digest
from experiments.common.report import Row

log = logging.getLogger(__name__)
ROOT, FILE, FOUND = Path(__file__).parents[1], "claims.yaml", "found.json"
HOLDS, BROKEN, UNCHECKED = "holds", "DOES NOT HOLD", "not checked here"
ABREAST = 2  # small studies at a time


@dataclass(frozen=True, kw_only=True)
class Check:
    """Some claims of one study that a single small version of it checks; see the module."""

    table: str
    named_by: tuple[str, ...]
    number: str
    intervals: tuple[str, ...]
    settings: Mapping[str, Any] | None = None
    where: Mapping[str, Any] = field(default_factory=dict)
    note: str = ""
    alone: bool = False

    def rows_of(self, table: Sequence[Row]) -> dict[str, list[Row]]:
        """Return name of a claim -> the rows of a table that belong to it."""
        found: dict[str, list[Row]] = {}
        for row in table:
            if all(row.get(k) in (v if isinstance(v, tuple) else (v,)) for k, v in self.where.items()):
                name = ", ".join(str(row[column]) for column in self.named_by if row[column] not in ("", None))
                found.setdefault(name, []).append(row)
        return found

    def interval(self, rows: Sequence[Row]) -> tuple[float, float, float]:
        """Return the number, and both ends of its interval."""
        if len(rows) > 1:
            won, flown = (sum(row[column] for row in rows) for column in ("success", "episodes"))
            low, high = wilson(won, flown)
            return 100 * won / flown, 100 * low, 100 * high
        (row,) = rows
        ends = [row[f"{name}_{end}"] for name in self.intervals for end in ("low", "high") if f"{name}_{end}" in row]
        ends += [row[name] for name in ("worst", "best") if "singles" in self.intervals]
        known = [end for end in (*ends, row[self.number]) if end is not None]
        for name in (name for name in self.intervals if isinstance(row.get(name), str)):  # "0.67-0.79"
            known += map(float, row[name].split("-"))
        return row[self.number], min(known), max(known)


def checks_of(name: str, root: Path = ROOT) -> list[Check]:
    """Return the checks of a study; none where it makes no headline claim."""
    file = root / name / FILE
    said = yaml.safe_load(file.read_text(encoding="utf-8")) if file.is_file() else []
    return [build(Check, each, at=f"{file}: ") for each in said]


def checked(
    names: Sequence[str], folder: Path, *, root: Path = ROOT, abreast: int = ABREAST, progress: bool = True
) -> list[Row]:
    """Measure the small versions that ``folder`` does not hold yet; return a row for each claim.

    Args:
        names: of studies. folder: for what must survive a kill. root: of all studies. abreast: studies at a time; 0
            for all in this process. progress: say on stderr what is done.
    """
    started = time.perf_counter()
    jobs = [(name, place, check) for name in names for place, check in enumerate(checks_of(name, root))]
    done: dict[tuple[str, int], Mapping[str, Any]] = {}
    todo = [(name, place, check) for name, place, check in jobs if check.settings is not None]
    pool = ProcessPoolExecutor(abreast, mp_context=get_context("spawn")) if abreast else None
    os.environ["OMP_NUM_THREADS"] = "1"
    try:
        for job in (job for job in todo if job[2].alone or pool is None):
            done[job[:2]] = _measured(*job, folder)
        flying = {job[:2]: pool.submit(_measured, *job, folder) for job in todo if pool and not job[2].alone}
        for key, future in flying.items():
            done[key] = future.result()
            if progress:
                log.info("%s, check %d: %.0f s", *key, done[key]["wall_s"])
    finally:
        if pool:
            pool.shutdown(cancel_futures=True)
    rows = [row for name, place, check in jobs for row in judged(name, check, done.get((name, place)), root)]
    busy = sum(found["processor_s"] for found in done.values())
    log.info("%d claims: %.0f s, processor time %.0f s.", len(rows), time.perf_counter() - started, busy)
    return rows


def judged(name: str, check: Check, found: Mapping[str, Any] | None, root: Path = ROOT) -> Iterator[Row]:
    """Yield a row for each claim of a check.

    Args:
        name: of the study. found: what its small version gave, ``tables`` or ``error``; None where there is none.

    Raises:
        InvalidValueError: the recorded results have no such row.
    """
    recorded = json.loads((root / name / NUMBERS).read_text(encoding="utf-8"))
    claims = check.rows_of(recorded["tables"].get(check.table, ()))
    if not claims:
        raise InvalidValueError(f"{root / name / FILE}: no row of {check.table!r} in {NUMBERS} is where it says.")
    now = {} if found is None else check.rows_of(found.get("tables", {}).get(check.table, ()))
    for claim, rows in claims.items():
        value, low, high = check.interval(rows)
        row = {"claim": f"{name}: {claim}", "recorded": f"{value:g} ({low:.4g} to {high:.4g})", "now": "", "flown": ""}
        if found is None:
            yield {**row, "verdict": UNCHECKED, "note": f"{check.note}{'; ' * bool(check.note)}{recorded['command']}"}
        elif claim not in now:
            why = found.get("error", "the small version did not measure it")
            yield {**row, "verdict": BROKEN, "note": why}
        else:
            again, lowest, highest = check.interval(now[claim])
            yield {
                **row,
                "now": f"{again:.4g} ({lowest:.4g} to {highest:.4g})",
                "flown": sum(each.get("episodes", each.get("flown", 0)) for each in now[claim]) or "",
                "verdict": HOLDS if lowest <= high and low <= highest else BROKEN,
                "note": check.note,
            }


def _measured(name: str, place: int, check: Check, folder: Path) -> dict[str, Any]:
    """Return the tables of a small version, or the error that it ended with, and the time it took."""
    made = provenance()
    decided_by = {"settings": check.settings or {}, "git": made["git"], "packages": made["packages"], "engine": ENGINE}
    kept = folder / name / f"{place}-{digest(decided_by)}" / FOUND
    if kept.exists():
        return json.loads(kept.read_text(encoding="utf-8"))
    started, before = time.perf_counter(), _processor_s()
    try:
        study = build(registry.get("study", name), check.settings or {}, base=registry.get("study", name)())
        found: dict[str, Any] = {"tables": study.run(kept.parent, progress=False).to_dict()["tables"]}
    except Exception as error:  # one broken study must not hide what the others say
        log.exception("%s", name)
        return {"error": f"{type(error).__name__}: {error}", "wall_s": 0.0, "processor_s": 0.0}
    found |= {"wall_s": time.perf_counter() - started, "processor_s": _processor_s() - before}
    write_json(kept, found)
    return found


def _processor_s() -> float:
    """Return the processor time of this process and of those that it started and that have ended, s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)
