"""Evaluations as frames: one row per flight, and two evaluations side by side."""

from __future__ import annotations

import os

import pandas as pd

from aerial_il.evaluation import compare as comparing
from aerial_il.evaluation.result import EvaluationResult, load_result

Evaluation = EvaluationResult | str | os.PathLike[str]


def read(evaluation: Evaluation) -> EvaluationResult:
    """Return an evaluation as it is, or that which lies in a folder or file."""
    return evaluation if isinstance(evaluation, EvaluationResult) else load_result(evaluation)


def evaluation(evaluation: Evaluation) -> pd.DataFrame:
    """Return one row per flight, by seed, of an evaluation: an object, its folder, or its ``evaluation.json``.

    Returns:
        Columns: ``robot``, ``task``, ``tier``, ``policy``, then the fields of
        :class:`aerial_il.evaluation.metrics.EpisodeRecord` as ``evaluation.json`` names them, those with several
        numbers as ``subtasks.NAME``. SI units; missing where a flight has no such number.

    Raises:
        InvalidValueError: the file is missing, is no evaluation, or contradicts itself.
    """
    result = read(evaluation)
    head = {"robot": result.robot, "task": result.task, "tier": result.tier, "policy": result.policy}
    return pd.json_normalize([head | episode.to_dict() for episode in result.episodes])


def compare(a: Evaluation, b: Evaluation) -> pd.DataFrame:
    """Return the means of two evaluations, one row per number, as ``aerial-il compare`` tells them.

    Returns:
        Index: ``success``, then the metrics. Columns: ``label``, ``unit``, ``a``, ``b``, ``difference`` (b - a) with
        its 95 % interval ``low`` to ``high`` (of a metric by bootstrap), ``p_value``, and ``p_adjusted`` by Holm's
        method for all metrics at once (success, the question asked, is not among them). ``frame.attrs`` has the
        names, the method, and the seeds that only one of them won.

    Raises:
        InvalidValueError: robots or tasks differ.
    """
    found = comparing.compare(read(a), read(b))
    low, high = found.ci95
    rows = {
        "success": {
            "label": "Success",
            "unit": "",
            "a": found.rate_a,
            "b": found.rate_b,
            "difference": found.difference,
            "low": low,
            "high": high,
            "p_value": found.p_value,
        }
    }
    for change in found.changes:
        rows[change.key] = {
            "label": change.label,
            "unit": change.unit,
            "a": change.mean_a,
            "b": change.mean_b,
            "difference": change.difference,
            "low": change.ci95.lo,
            "high": change.ci95.hi,
            "p_value": change.p_value,
            "p_adjusted": change.p_adjusted,
        }
    columns = ["label", "unit", "a", "b", "difference", "low", "high", "p_value", "p_adjusted"]
    frame = pd.DataFrame.from_dict(rows, orient="index").reindex(columns=columns)
    frame.attrs = {"a": found.a, "b": found.b, "method": found.method, "paired": found.paired}
    frame.attrs |= {"only_a": list(found.only_a), "only_b": list(found.only_b)}
    return frame
