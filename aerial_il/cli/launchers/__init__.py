"""Launchers, one file each: where and how many at a time the jobs of a sweep run. A new file here is a new one.

A launcher is a dataclass of settings, ``launcher.KEY=VALUE``, with a method ``launch``. Whichever starts them, jobs are
processes of their own in a fixed number of threads, so that their results are the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:  # numpy comes with them, which help and completion do without
    from aerial_il.cli.sweeps.board import Board
    from aerial_il.cli.sweeps.job import Job


class Launcher(Protocol):
    """Runs jobs somewhere."""

    def launch(self, jobs: Sequence[Job], board: Board) -> None:
        """Run ``jobs`` and tell ``board`` what starts and ends; one that fails does not stop the others.

        Stopped by a signal, it stops what it has started, or leaves it where it can be found again.
        """
        ...
