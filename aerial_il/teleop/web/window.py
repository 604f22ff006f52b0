"""A window of its own for the page: a browser without tabs and address bar, whose keys belong to the flight alone."""

import shutil
import subprocess
from collections.abc import Sequence

from aerial_il.core.errors import AerialError

BROWSERS = (
    *("chromium", "chromium-browser", "google-chrome", "google-chrome-stable"),
    *("microsoft-edge", "brave-browser"),
)
SIZE = (1280, 800)


class NoWindowError(AerialError):
    """There is no browser here that opens windows without tabs."""


def window_program() -> str:
    """Return the program that opens such windows.

    Raises:
        NoWindowError: names those that do, and how to get one.
    """
    for name in BROWSERS:
        if program := shutil.which(name):
            return program
    raise NoWindowError(
        f"ui=window needs one of {', '.join(BROWSERS)}, and none is on the path. Install one, e.g. "
        "`sudo apt install chromium`, or leave out ui=window and open the page in any browser."
    )


def open_window(program: str, url: str, options: Sequence[str] = ()) -> subprocess.Popen[bytes]:
    """Open ``url`` in a window of its own; the flight goes on when it is closed."""
    words = [program, f"--app={url}", f"--window-size={SIZE[0]},{SIZE[1]}", *options]
    return subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
