"""What commands say that serve a page."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from aerial_il.workflows.parts.local_server import LocalServer


def greeting(what: str, end: str, *, open_page: bool) -> Callable[[LocalServer], None]:
    """Return a function that says where a page is, what is done there and how it ends, and opens it where it can.

    Args:
        what: is done there, such as ``Look``. end: what Ctrl-C does. open_page: in a browser, where there is a screen.
    """

    def greet(server: LocalServer) -> None:
        import webbrowser

        from aerial_il.presentation.films.window import has_screen

        print(f"{what} here: {server.url}\nCtrl-C ends it{end}.", flush=True)
        if open_page and has_screen():
            webbrowser.open(server.url)

    return greet
