"""Evaluations as frames: one row per flight, and two evaluations side by side."""

import math
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
    """Return the means of two evaluations, one row per number, as ``aerial-il compare`` prints them.

    Returns:
        Index: ``success``, then the metrics. Columns: ``label``, ``unit``, ``a``, ``b``, ``difference`` (b - a) with
        its 95 % interval ``low`` to ``high`` (of a metric by bootstrap), ``p_value``, and ``p_adjusted`` by Holm's
        method for all metrics at once (success, the question asked, is not among them). ``frame.attrs`` has the
        names, the method, and the seeds that only one of them won.

    Raises:
        InvalidValueError: robots or tasks differ.
    """
    result = comparing.compare(read(a), read(b))
    columns = ["label", "unit", "a", "b", "difference", "low", "high", "p_value", "p_adjusted"]
    success = ("Success", "", result.rate_a, result.rate_b, result.difference, *result.ci95, result.p_value, math.nan)
    rows = {"success": success} | {
        c.key: (c.label, c.unit, c.mean_a, c.mean_b, c.difference, *c.ci95, c.p_value, c.p_adjusted)
        for c in result.changes
    }
    frame = pd.DataFrame.from_dict(rows, orient="index", columns=pd.Index(columns))
    frame.attrs = {name: getattr(result, name) for name in ("a", "b", "method", "paired")}
    frame.attrs |= {"only_a": list(result.only_a), "only_b": list(result.only_b)}
    return frame
