"""Results that are printed for people, or as JSON for other programs."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class AsJson:
    """How a result is printed.

    Attributes:
        json: print one JSON object (also: --json).
    """

    json: bool = False

    def show(self, plain: Any, text: Callable[[], str]) -> None:
        """Print a result's plain values as JSON, or its text."""
        print(json.dumps(plain, indent=2) if self.json else text())
