"""Rows and targets about success, alike in every benchmark that flies episodes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import Interval, bootstrap_macro, t_interval, wilson_of_seeds
from aerial_il.evaluation.training_run import rollouts_of
from experiments.common.report import Row, Target


def success_row(result: EvaluationResult) -> Row:
    """Return count, rate, 95 % Wilson interval, time to success and crashes of an evaluation."""
    low, high = result.success["ci95"]
    seconds = result.metrics["time_to_success_s"]
    return {
        "success": result.success["count"],
        "episodes": len(result.episodes),
        "percent": _percent(result.success["rate"]),
        "ci95_low": _percent(low),
        "ci95_high": _percent(high),
        "time_s": None if seconds["mean"] is None else round(seconds["mean"], 2),
        "time_sd_s": None if seconds["std"] is None else round(seconds["std"], 2),
        "crashes": result.metrics["ends"]["crash"],
    }


def mean_time_s(results: Iterable[EvaluationResult], *, digits: int = 2) -> float | None:
    """Return the mean time to success, s, of all flights that succeed, rounded; None where none does."""
    times = [e.time_to_success_s for result in results for e in result.episodes if e.time_to_success_s is not None]
    return round(float(np.mean(times)), digits) if times else None


def pooled_row(results: Iterable[EvaluationResult]) -> Row:
    """Return success over several trainings of one arm, with both intervals that such a number has.

    ``flights``: 95 % interval over all flights of these very policies, Wilson's; flights of one seed by several of them
    count as fewer where they tend to end alike. ``trainings``: Student's 95 % interval
    with a training (its demonstrations, weights and flights) as the unit, within [0, 100]; None of a single one. It has
    no width where all trainings fly alike, and then says less than the flights do.
    """
    results = list(results)
    counts = [(result.success["count"], len(result.episodes)) for result in results]
    count, episodes = (sum(column) for column in zip(*counts, strict=True))
    rates = np.array([won / flown for won, flown in counts])
    return {
        "trainings": len(counts),
        "success": count,
        "episodes": episodes,
        "percent": _percent(count / episodes),
        **_interval("flights", wilson_of_seeds([{e.seed: e.success for e in each.episodes} for each in results])),
        **_interval("trainings", t_interval(rates)),
        "worst": _percent(rates.min()),
        "best": _percent(rates.max()),
    }


def pooled_rows(results: Iterable[tuple[Row, EvaluationResult]]) -> Iterator[Row]:
    """Yield a row for each cell, over all of its evaluations, in the order in which cells come first.

    Args:
        results: pairs of a cell, as the row is to name it, and one evaluation there.
    """
    groups: dict[tuple[tuple[str, Any], ...], list[EvaluationResult]] = {}
    for cell, result in results:
        groups.setdefault(tuple(cell.items()), []).append(result)
    yield from (dict(cell) | pooled_row(judged) for cell, judged in groups.items())


def macro_row(tasks: Mapping[str, Sequence[EvaluationResult]]) -> Row:
    """Return the mean success over tasks, each flown by one policy of each draw, with both of its intervals.

    ``flights``: bootstrap over the flights of these very policies. ``trainings``: Student's interval over the draws'
    own means over tasks.

    Args:
        tasks: task -> one evaluation of each draw, in their order, all of as many flights.

    Raises:
        InvalidValueError: tasks differ in their number of draws.
    """
    counts = np.array([[result.success["count"] for result in found] for found in _alike(tasks)])
    episodes = len(next(iter(tasks.values()))[0].episodes)
    rates = dict(zip(tasks, counts.mean(axis=1) / episodes, strict=True))
    worst = min(rates, key=lambda task: rates[task])
    each = [[int(count)] for count in counts.ravel()]
    return {
        "tasks": len(tasks),
        "trainings": counts.size,
        "draws": counts.shape[1],
        "flights": counts.size * episodes,
        "percent": _percent(counts.mean() / episodes),
        **_interval("flights", bootstrap_macro(each, episodes, rng=named_rng(0, "benchmarks", "macro"))),
        **_interval("trainings", t_interval(counts.mean(axis=0) / episodes)),
        "worst": f"{worst} ({100 * rates[worst]:.0f} %)",
    }


def pooled_target(what: str, percent: float, row: Row) -> Target:
    """Return the target that the success of ``row`` (pooled or macro) be at least ``percent``."""
    return Target(what, "at least", percent, row["percent"], "%", spread_of(row))


def spread_of(row: Row) -> str:
    """Return both intervals of a pooled or macro row in words."""
    flights = f"flights {row['flights_low']:g} to {row['flights_high']:g} %"
    if row["trainings_low"] is None:
        return f"{flights}; a single training"
    return f"{flights}; trainings {row['trainings_low']:g} to {row['trainings_high']:g} %"


def _alike(tasks: Mapping[str, Sequence[EvaluationResult]]) -> Iterable[Sequence[EvaluationResult]]:
    if len({len(found) for found in tasks.values()}) > 1:
        raise InvalidValueError("A mean over tasks needs as many trainings of each: fly the draws that are missing.")
    return tasks.values()


def interval_ends(name: str, found: Interval, *, scale: float = 1.0, digits: int = 1) -> Row:
    """Return both ends, scaled and rounded, as ``NAME_low`` and ``NAME_high``; None where there is no interval."""
    known = math.isfinite(found.lo)
    ends = {"low": found.lo, "high": found.hi}
    return {f"{name}_{end}": round(float(scale * value), digits) if known else None for end, value in ends.items()}


def _interval(name: str, found: Interval) -> Row:
    """Return both ends within [0, 100] %, None where there is no interval."""
    return interval_ends(name, Interval(*np.clip(found, 0.0, 1.0)), scale=100)


def gain_row(name: str, rates: np.ndarray, others: np.ndarray) -> Row:
    """Return by how many points trainings are better than others, paired: the mean, called ``name``, and its interval.

    Args:
        rates, others: (N,) success of each training, those of one draw at the same place.

    Returns:
        With ``low`` and ``high`` of Student's 95 % interval over draws, None of a single one, and ``draws``.
    """
    gain = 100 * (rates - others)
    ends = [None if math.isnan(end) else round(end, 1) for end in t_interval(gain)]
    return {name: round(float(gain.mean()), 1), **dict(zip(("low", "high"), ends, strict=True)), "draws": len(gain)}


def success_target(what: str, percent: float, row: Row) -> Target:
    """Return the target that the success of ``row`` be at least ``percent``."""
    spread = f"95 % interval {row['ci95_low']:g} to {row['ci95_high']:g} %, {row['success']}/{row['episodes']}"
    return Target(what, "at least", percent, row["percent"], "%", spread)


def success_on_the_way(run: Path) -> list[tuple[float, float]]:
    """Return (steps, success in percent) of the evaluations during the training in the folder ``run``."""
    return [(rollouts.step, 100 * rollouts.rate) for rollouts in rollouts_of(read_metrics(run))]


def failed_seeds(result: EvaluationResult) -> list[int]:
    """Return the seeds of the episodes without success, for who wants to look at them."""
    return [episode.seed for episode in result.episodes if not episode.success]


def _percent(share: float) -> float:
    return round(100.0 * float(share), 1)
