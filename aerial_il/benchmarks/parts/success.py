"""Rows and targets about success, alike in every benchmark that flies episodes."""

from __future__ import annotations

from collections.abc import Iterable

from aerial_il.benchmarks.parts.report import Row, Target
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import wilson


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


def pooled_row(results: Iterable[EvaluationResult]) -> Row:
    """Return success over several evaluations of one task: of all episodes, and of the worst and best evaluation."""
    counts = [(result.success["count"], len(result.episodes)) for result in results]
    count, episodes = (sum(column) for column in zip(*counts, strict=True))
    low, high = wilson(count, episodes)
    rates = [_percent(won / flown) for won, flown in counts]
    return {
        "seeds": len(counts),
        "success": count,
        "episodes": episodes,
        "percent": _percent(count / episodes),
        "ci95_low": _percent(low),
        "ci95_high": _percent(high),
        "worst_seed": min(rates),
        "best_seed": max(rates),
    }


def success_target(what: str, percent: float, row: Row) -> Target:
    """Return the target that the success of ``row`` be at least ``percent``."""
    spread = f"95 % interval {row['ci95_low']:g} to {row['ci95_high']:g} %, {row['success']}/{row['episodes']}"
    return Target(what, "at least", percent, row["percent"], "%", spread)


def failed_seeds(result: EvaluationResult) -> list[int]:
    """Return the seeds of the episodes without success, for who wants to look at them."""
    return [episode.seed for episode in result.episodes if not episode.success]


def _percent(share: float) -> float:
    return round(100.0 * share, 1)
