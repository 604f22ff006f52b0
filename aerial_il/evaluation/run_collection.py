"""All training runs below a folder, read together: what they differ in, how far they came, and which cannot be read."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from aerial_il.core.errors import AerialError, InvalidValueError, UnknownNameError
from aerial_il.evaluation.result import TRASH
from aerial_il.evaluation.training_run import CONFIG, METRICS, TrainingRun, is_run, read_run

NO_RUN = "holds no training run"
_INSIDE = {"checkpoints", "tensorboard", "policy", "best", "wandb", "mlruns", TRASH}  # of runs; no runs are in them
_CONDITION = re.compile(r"(?P<key>[^=!<>~]+)(?P<sign>!=|<=|>=|=|<|>|~)(?P<value>.*)", re.DOTALL)
_ORDERED: Mapping[str, Callable[[Any, Any], bool]] = {
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
    "~": lambda a, b: fnmatchcase(str(a), str(b)),
}


@dataclass(frozen=True, eq=False)
class RunCollection:
    """The runs below a folder.

    Attributes:
        folder: where they were looked for. runs: by name. refused: folder -> why it is no run that can be read.
        axes: settings in which all runs of the folder differ, the seed among them -> their values, in order.
    """

    folder: Path
    runs: tuple[TrainingRun, ...]
    refused: Mapping[Path, str]
    axes: Mapping[str, list[Any]]

    def __repr__(self) -> str:
        return f"RunCollection({self.folder}: {len(self.runs)} runs, {len(self.refused)} refused)"

    def name(self, run: TrainingRun) -> str:
        """Return a run's path below the folder."""
        return os.path.relpath(run.path, self.folder)

    def row(self, run: TrainingRun) -> dict[str, Any]:
        """Return name, state, axes, steps, last loss, last rollouts, evaluations of a run; no times, so it repeats."""
        settings = settings_of(run)
        last = run.rollouts[-1] if run.rollouts else None
        losses = [row["loss"] for row in run.rows if "loss" in row]
        row = {"run": self.name(run), "state": state_of(run)}
        row |= {axis: settings.get(axis) for axis in self.axes}
        row |= {"steps": run.steps, "loss": losses[-1] if losses else None}
        row |= {"success": last.rate if last else None, "ci95": list(last.ci95) if last else None}
        own = {*row, *settings}
        judged = {f"evaluation/{n}" if n in own else n: each.success["rate"] for n, each in run.judged.items()}
        return row | judged

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Return all rows, each with every column."""
        rows = [self.row(run) for run in self.runs]
        columns = dict.fromkeys(column for row in rows for column in row)
        return [{column: row.get(column) for column in columns} for row in rows]

    def where(self, conditions: Sequence[str]) -> RunCollection:
        """Return the runs that fulfil all ``conditions``, such as ``success>0.5``, ``policy.name=mlp``, ``run~seed=*``.

        Raises:
            InvalidValueError: one is no condition. UnknownNameError: no run has what it names.
        """
        kept = list(self.runs)
        for condition in conditions:
            key, holds = self._condition(condition)
            kept = [run for run in kept if holds(self._value(run, key))]
        return replace(self, runs=tuple(kept))

    def sorted_by(self, key: str) -> RunCollection:
        """Return the runs by a column or setting, downwards where ``-`` stands before it; those without it last."""
        name = self._known(key.removeprefix("-"))
        pairs = [(self._value(run, name), run) for run in self.runs]
        there = sorted(((v, run) for v, run in pairs if v is not None), key=lambda pair: _order(pair[0]))
        there = there[::-1] if key.startswith("-") else there
        runs = [run for _, run in there] + [run for value, run in pairs if value is None]
        return replace(self, runs=tuple(runs))

    def _value(self, run: TrainingRun, key: str) -> Any:
        return {**settings_of(run), **self.row(run)}.get(key)

    def _condition(self, text: str) -> tuple[str, Callable[[Any], bool]]:
        parts = _CONDITION.fullmatch(text.strip())
        if parts is None:
            signs = " ".join(("=", "!=", *_ORDERED))
            raise InvalidValueError(f"where={text} is not a condition; give KEY=VALUE, or one of {signs}.")
        sign, text_wanted = parts["sign"], parts["value"].strip()
        wanted = _read(text_wanted)

        def holds(value: Any) -> bool:
            if sign in ("=", "!="):
                return (value == wanted or str(value) == text_wanted) == (sign == "=")
            try:
                return bool(_ORDERED[sign](value, wanted))
            except TypeError:  # a run without this number, or text compared with one
                return False

        return self._known(parts["key"].strip()), holds

    def _known(self, key: str) -> str:
        """Return the column or setting that ``key`` names, the end of its name being enough where that is one alone."""
        known = dict.fromkeys(name for run in self.runs for name in (*self.row(run), *settings_of(run)))
        ends = [name for name in known if name == key or name.endswith(f".{key}")]
        if key in known or len(ends) == 1 or not known:
            return key if key in known or not known else ends[0]
        raise UnknownNameError("column or setting", key, ends or known)


def read_runs(folder: str | os.PathLike[str]) -> RunCollection:
    """Read all runs below ``folder``; what cannot be read, or is no run, is named with the reason.

    Raises:
        InvalidValueError: there is no such folder.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InvalidValueError(
            f"{folder} is not a folder. Train some runs: aerial-il train dataset=PATH run=runs/NAME"
        )
    runs, refused = list[TrainingRun](), dict[Path, str]()
    for place in _candidates(folder):
        try:
            runs.append(read_run(place))
        except AerialError as error:
            refused[place] = _half_written(place) or " ".join(str(error).split())
    others = [] if is_run(folder) else _others(folder, {*(run.path for run in runs), *refused})
    refused |= dict.fromkeys(others, NO_RUN)
    return RunCollection(folder, tuple(runs), refused, axes_of(runs))


def axes_of(runs: Sequence[TrainingRun]) -> dict[str, list[Any]]:
    """Return the settings in which ``runs`` differ -> their values, in order."""
    each = [settings_of(run) for run in runs]
    axes = {}
    for key in dict.fromkeys(key for settings in each for key in settings):
        values = {repr(settings.get(key)): settings.get(key) for settings in each}
        if len(values) > 1:
            axes[key] = sorted(values.values(), key=_order)
    return axes


def settings_of(run: TrainingRun) -> dict[str, Any]:
    """Return a run's settings by the names that are typed: ``algorithm.lr``, ``policy.chunk``, ``seed``."""
    named = {f"algorithm.{k[9:]}" if k.startswith("settings.") else k: value for k, value in run.setup.items()}
    return {"seed": run.seed, **named}


def state_of(run: TrainingRun) -> str:
    """Return whether a run is finished, or how far it came."""
    total = run.config.get("settings", {}).get("steps")
    return "finished" if run.finished else f"step {run.steps}" + (f" of {total}" if total else "")


def inner_runs(run: Path) -> list[Path]:
    """Return the runs that lie in the folder of another one, which are not listed."""
    inner = (child for child in sorted(run.iterdir()) if child.is_dir() and not child.is_symlink())
    return [place for child in inner if child.name not in _INSIDE for place in _candidates(child)]


def _candidates(folder: Path) -> list[Path]:
    """Return the folders that are runs or begin to be, by name; a run's own folders and links are not entered."""
    runs: list[Path] = []
    for place, inner, files in os.walk(folder):
        if CONFIG in files or METRICS in files:
            runs.append(Path(place))
            inner.clear()
        inner[:] = sorted(name for name in inner if name not in _INSIDE and not name.startswith("."))
    return sorted(runs)


def _others(folder: Path, read: set[Path]) -> list[Path]:
    """Return the folders right below ``folder`` in and below which nothing was ``read``."""
    known = read | {parent for place in read for parent in place.parents}
    entered = (child for child in sorted(folder.iterdir()) if child.is_dir() and not child.name.startswith("."))
    return [child for child in entered if child not in known and child.name not in _INSIDE]


def _half_written(place: Path) -> str:
    """Return what a folder lacks to be a run, empty if it has all."""
    lacking = [name for name in (CONFIG, METRICS) if not (place / name).is_file()]
    return f"half-written, or no run of ours: it lacks {' and '.join(lacking)}" if lacking else ""


def _read(text: str) -> Any:
    """Return a value as it is meant: a number, true, false, null, or text."""
    named = {"true": True, "false": False, "null": None}
    for kind in (named.__getitem__, int, float):
        with suppress(KeyError, ValueError):
            return kind(text)
    return text


def _order(value: Any) -> tuple[int, Any]:
    """Return by what values of several types are sorted: none, numbers, then text."""
    if value is None:
        return (0, 0)
    return (1, value) if isinstance(value, int | float) else (2, str(value))
