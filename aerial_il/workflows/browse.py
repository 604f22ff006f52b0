"""Look through the episodes of a dataset on a page, watch them, mark them, and edit those that are marked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from aerial_il.workflows.parts.names import at_least

if TYPE_CHECKING:
    from aerial_il.workflows.parts.browse_server import BrowseServer


@dataclass(frozen=True, kw_only=True)
class Browse:
    """What is looked through, and where.

    Attributes:
        dataset: whose episodes are shown; those of a folder of recordings can be edited.
        out: write the page as a file (.html), on which marks become a command, instead of serving it (null: serve it).
        port: of the page, on this machine alone; 0 for any that is free.
        open: open the page in a browser, where there is a screen.
        progress: show a progress bar while episodes are read.
    """

    dataset: str
    out: str | None = None
    port: int = 8643
    open: bool = True
    progress: bool = True

    def __post_init__(self) -> None:
        at_least(self, port=0)


def browse(settings: Browse, opened: Callable[[BrowseServer], None] = lambda server: None) -> Path | None:
    """Write the page and return its file; or serve it until interrupted, once ``opened`` was told where.

    Raises:
        InvalidValueError: the port is taken, or ``out`` is somebody else's. DemoError: there is nothing to show.
    """
    from aerial_il.core.places import claim_file
    from aerial_il.data.dataset import open_dataset
    from aerial_il.data.table import read_table
    from aerial_il.presentation.pages.browse import write_browse_page
    from aerial_il.workflows.parts.browse_server import BrowseServer

    if settings.out is not None:
        claim_file(settings.out)
    dataset = open_dataset(settings.dataset, failures=True, states=False)
    rows = read_table(dataset, progress=settings.progress)
    if settings.out is not None:
        return write_browse_page(settings.out, settings.dataset, rows)
    with BrowseServer(settings.dataset, settings.port) as server:
        opened(server)
        server.serve_forever()
    return None
