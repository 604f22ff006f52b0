"""Compare two evaluations: the difference in success with its interval and p-value, paired by seed where possible.

Example: aerial-il compare runs/one/evaluation runs/two/evaluation
"""

from __future__ import annotations

import json
from dataclasses import dataclass

from aerial_il.cli.keys import MISSING, key


@dataclass
class Config:
    a: str = key(MISSING, "evaluation.json, or the folder that holds it", position=0)
    b: str = key(MISSING, "the other one", position=1)
    json: bool = key(False, "print one JSON object (also: --json)")


def run(config: Config) -> None:
    """Print the comparison."""
    from aerial_il.evaluation.compare import compare
    from aerial_il.evaluation.result import load_result

    comparison = compare(load_result(config.a), load_result(config.b))
    print(json.dumps(comparison.to_dict(), indent=2) if config.json else comparison.summary())
