"""Put a dataset in order after a kill, a full disk or damage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from aerial_il.data.recovery import Recovered


@dataclass(frozen=True, kw_only=True)
class Recover:
    """What is recovered.

    Attributes:
        path: dataset, or one file.
    """

    path: str


def recover(settings: Recover) -> list[Recovered]:
    """Recover, and return what became of each file that needed help."""
    from aerial_il.data import recovery

    return list(recovery.recover(settings.path))
