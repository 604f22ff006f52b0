"""What practice added to the policy that it began with, on the same flights."""

from __future__ import annotations

from collections.abc import Sequence

from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import mcnemar
from experiments.common.report import Row

SIGNIFICANT = 0.05


def gain_row(pairs: Sequence[tuple[EvaluationResult, EvaluationResult]]) -> Row:
    """Return success before and after practice, and how many flights were won and lost by it.

    Args:
        pairs: of each training, the policy that it began with and the final one, flown on the same seeds.

    Returns:
        ``before`` and ``after`` in percent; ``won`` and ``lost``, flights that only the latter or only the former
        solves; ``p``, McNemar's exact two-sided p-value over all flights.
    """
    solved = [(_solved(before), _solved(after)) for before, after in pairs]
    flown = sum(len(before.episodes) for before, _ in pairs)
    won, lost = (sum(map(len, sides)) for sides in zip(*((b - a, a - b) for a, b in solved), strict=True))
    return {
        "before": round(100 * sum(len(before) for before, _ in solved) / flown, 1),
        "after": round(100 * sum(len(after) for _, after in solved) / flown, 1),
        "won": won,
        "lost": lost,
        "p": float(f"{mcnemar(won, lost):.2g}"),
    }


def is_gain(row: Row) -> bool:
    """Whether practice solved significantly more than what it began with."""
    return row["won"] > row["lost"] and row["p"] < SIGNIFICANT


def _solved(result: EvaluationResult) -> set[int]:
    return {episode.seed for episode in result.episodes if episode.success}
