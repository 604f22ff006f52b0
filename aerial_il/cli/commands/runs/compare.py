"""Compare two evaluations: the difference in success with its interval and p-value, paired by seed where possible.

Example: aerial-il compare runs/one/evaluation runs/two/evaluation
"""

from __future__ import annotations

from dataclasses import dataclass

from aerial_il.cli.as_json import AsJson
from aerial_il.workflows.compare import Compare, compare


@dataclass(frozen=True, kw_only=True)
class Shown(AsJson, Compare):
    """How it is shown."""


SETTINGS, BARE = Shown, ("a", "b")


def run(settings: Shown) -> None:
    """Print the comparison."""
    comparison = compare(settings)
    settings.show(comparison.to_dict(), comparison.summary)
