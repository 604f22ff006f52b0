"""Compare evaluations: two in all their numbers, paired by seed where possible; several in one ranking."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

from aerial_il.core.errors import InvalidValueError

if TYPE_CHECKING:
    from aerial_il.evaluation.compare import Comparison
    from aerial_il.evaluation.ranking import Ranking
    from aerial_il.evaluation.result import EvaluationResult

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Compare:
    """What is compared.

    Attributes:
        result: evaluations, two or more: each an evaluation.json, or a folder with one or several at any depth below.
    """

    result: tuple[str, ...]


def compare(settings: Compare) -> Comparison | Ranking:
    """Return the comparison of two evaluations, or the ranking of several.

    A warning is logged where they were not flown under the same conditions.

    Raises:
        InvalidValueError: there are fewer than two, or they are not of one robot and task.
    """
    from aerial_il.evaluation import compare as pairs
    from aerial_il.evaluation.ranking import rank

    results = {name: each for place in settings.result for name, each in _results(place).items()}
    if len(results) < 2:
        hint = "Name two or more: aerial-il compare runs/a/evaluation runs/b/evaluation"
        raise InvalidValueError(f"result={list(settings.result)} holds {len(results)} evaluation(s). {hint}")
    both = list(results.values())
    for note in dict.fromkeys(note for a, b in combinations(both, 2) for note in pairs.other_conditions(a, b)):
        log.warning("%s", note)
    return pairs.compare(*both) if len(both) == 2 else rank(results)


def _results(place: str) -> dict[str, EvaluationResult]:
    """Return name -> evaluation of all that lie in a place."""
    from aerial_il.evaluation.result import FILE_NAME, find_results, load_result

    path = Path(place)
    if path.is_file() or (path / FILE_NAME).exists() or not path.is_dir():
        return {place: load_result(place)}
    return {str(folder): load_result(folder) for folder in find_results(path)}
