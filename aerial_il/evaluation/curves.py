"""The background of an evaluated policy: its demonstrations, its training curves, its learning curve."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aerial_il.core.bounded import parse_json, read_text
from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation.result import EvaluationResult

CURVE_POINTS = 300


@dataclass(frozen=True)
class DatasetSummary:
    """The demonstrations that a policy learned from.

    Attributes:
        name: path or name of the dataset.
        episodes, successes: how many there are, and how many of them succeeded.
        steps: control steps in all of them.
        duration_s: simulated time of all of them.
        seeds: first and last seed, None where none is recorded.
    """

    name: str
    episodes: int
    successes: int
    steps: int
    duration_s: float
    seeds: tuple[int, int] | None

    @staticmethod
    def of(name: str, episodes: Iterable[Any]) -> DatasetSummary:
        """Read through a dataset (``aerial_il.open_dataset``) once and sum it up."""
        lengths, successes, duration_s, seeds = [], 0, 0.0, []
        for episode in episodes:
            lengths.append(len(episode.actions))
            successes += bool(episode.success)
            duration_s += len(episode.actions) * episode.spec.control_dt_s
            seeds += [episode.provenance["seed"]] if "seed" in episode.provenance else []
        span = (min(seeds), max(seeds)) if seeds else None
        return DatasetSummary(name, len(lengths), successes, sum(lengths), duration_s, span)


@dataclass(frozen=True, eq=False)
class Curve:
    """One logged number over training steps, thinned by averaging to at most 300 points."""

    name: str
    steps: np.ndarray
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class LearningPoint:
    """The evaluation of a policy that was trained on a number of demonstrations."""

    demonstrations: int
    result: EvaluationResult


def curves_of(rows: Iterable[Mapping[str, Any]]) -> list[Curve]:
    """Return one curve per number that was logged more than once."""
    series: dict[str, tuple[list[float], list[float]]] = {}
    for row in rows:
        for name, value in row.items():
            if name != "step" and isinstance(value, int | float) and np.isfinite(value):
                steps, values = series.setdefault(name, ([], []))
                steps.append(row["step"])
                values.append(value)
    return [Curve(name, _thin(steps), _thin(values)) for name, (steps, values) in series.items() if len(steps) > 1]


def read_rows(path: Path) -> Iterable[dict[str, Any]]:
    """Yield the rows of a ``metrics.jsonl``; a last one cut short by a kill is left out."""
    try:
        lines = read_text(path).splitlines(keepends=True)
    except (OSError, ValueError) as error:
        hint = "Give the folder of a training run."
        raise InvalidValueError(f"{path}: cannot be read ({error}). {hint}") from error
    for number, line in enumerate(lines, start=1):
        if not line.endswith("\n"):
            return  # a row cut short by a kill
        try:
            row = parse_json(line)
            yield {**row, "step": float(row["step"])}
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InvalidValueError(f"{path}, line {number}: not a row of metrics ({error!r}).") from error


def _thin(values: list[float]) -> np.ndarray:
    """Return the means of neighbours, where there are too many to draw; first and last stay as they were."""
    if len(values) <= CURVE_POINTS:
        return np.asarray(values, dtype=float)
    parts = np.array_split(np.asarray(values[1:-1], dtype=float), CURVE_POINTS - 2)
    return np.array([values[0], *(part.mean() for part in parts), values[-1]])
