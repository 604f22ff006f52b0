"""Compare two evaluations: the difference in success with its interval and p-value, paired by seed where possible."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from aerial_il.evaluation.compare import Comparison

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Compare:
    """What is compared.

    Attributes:
        a: evaluation.json, or the folder that holds it.
        b: the other one.
    """

    a: str
    b: str


def compare(settings: Compare) -> Comparison:
    """Return the comparison; a warning is logged where the two were not flown under the same conditions."""
    from aerial_il.evaluation import compare as evaluations
    from aerial_il.evaluation.result import load_result

    a, b = load_result(settings.a), load_result(settings.b)
    comparison = evaluations.compare(a, b)
    for note in evaluations.other_conditions(a, b):
        log.warning("%s", note)
    return comparison
