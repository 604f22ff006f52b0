"""Look through thousands of episodes on a page: plot, table, films; mark some, and delete or relabel them.

The page is served to this machine alone; films are made when they are asked for. Edits are those of aerial-il delete,
relabel and undo. out=PAGE.html writes it as a file that opens offline, on which marks become a command to type.

Example: aerial-il browse datasets/pick
Example: aerial-il browse datasets/pick out=pick.html
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from aerial_il.workflows.browse import Browse, browse

if TYPE_CHECKING:
    from aerial_il.workflows.parts.browse_server import BrowseServer

SETTINGS, BARE = Browse, ("dataset",)


def run(settings: Browse) -> None:
    """Write the page, or serve it until interrupted."""

    def greet(server: BrowseServer) -> None:
        import webbrowser

        from aerial_il.presentation.films.window import has_screen

        print(f"Look here: {server.url}\nCtrl-C ends it.", flush=True)
        if settings.open and has_screen():
            webbrowser.open(server.url)

    if (page := browse(settings, greet)) is not None:
        print(f"Page: {page}")
