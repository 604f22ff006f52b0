"""Compare two evaluations: the difference in success with its interval and p-value, paired by seed where possible.

Example: aerial-il compare runs/one/evaluation runs/two/evaluation
"""

from __future__ import annotations

import json
from dataclasses import dataclass

from aerial_il.cli.configuration.keys import MISSING, key


@dataclass
class Config:
    a: str = key(MISSING, "evaluation.json, or the folder that holds it", position=0)
    b: str = key(MISSING, "the other one", position=1)
    json: bool = key(False, "print one JSON object (also: --json)")


def run(config: Config) -> None:
    """Print the comparison, and a warning where the two were not flown under the same conditions."""
    import logging

    from aerial_il.evaluation.compare import compare, other_conditions
    from aerial_il.evaluation.result import load_result

    a, b = load_result(config.a), load_result(config.b)
    comparison = compare(a, b)
    for note in other_conditions(a, b):
        logging.getLogger(__name__).warning("%s", note)
    print(json.dumps(comparison.to_dict(), indent=2) if config.json else comparison.summary())
