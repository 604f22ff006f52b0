"""Progress on stderr: a bar on a terminal, a line every few seconds in a log."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from tqdm import tqdm

LINE_EVERY_S = 5.0


class Progress(tqdm):  # pyright: ignore[reportMissingTypeArgument]
    """tqdm, whose carriage returns would fill a log where there is no terminal; arguments are tqdm's own."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        if not is_terminal(kwargs.get("file") or sys.stderr):
            kwargs |= {"mininterval": LINE_EVERY_S, "miniters": 1, "ncols": 80, "dynamic_ncols": False}
        super().__init__(*args, **kwargs)

    @staticmethod
    def status_printer(file: Any) -> Callable[[str], None]:
        """Return what writes a state of the bar: over the last one, or in a log below it; tqdm ends the last line."""
        if is_terminal(file):
            return tqdm.status_printer(file)
        started = False

        def write_line(state: str) -> None:
            nonlocal started
            if state:
                file.write("\n" * started + state.rstrip())
                file.flush()
                started = True

        return write_line


def is_terminal(file: Any) -> bool:
    """Whether ``file`` is a terminal, on which lines can be written over."""
    return hasattr(file, "isatty") and file.isatty()
