"""Compare two evaluations: the difference in success with its interval and p-value, paired by seed where possible.

Example: aerial-il compare runs/one/evaluation runs/two/evaluation
"""

from __future__ import annotations

import json
from dataclasses import dataclass

from aerial_il.workflows.compare import Compare, compare


@dataclass(frozen=True, kw_only=True)
class Shown(Compare):
    """How it is shown.

    Attributes:
        json: print one JSON object (also: --json).
    """

    json: bool = False


SETTINGS, BARE = Shown, ("a", "b")


def run(settings: Shown) -> None:
    """Print the comparison."""
    comparison = compare(settings)
    print(json.dumps(comparison.to_dict(), indent=2) if settings.json else comparison.summary())
