"""Say where flights are cut that others are generated from: on a page, or by script."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from aerial_il.core.errors import InvalidValueError
from aerial_il.workflows.edit import set_cuts
from aerial_il.workflows.parts.names import at_least

if TYPE_CHECKING:
    from aerial_il.generation.cuts import Cut
    from aerial_il.workflows.parts.segment_server import SegmentServer


@dataclass(frozen=True, kw_only=True)
class Segmentation:
    """What is cut, and by whom.

    Attributes:
        dataset: folder of recordings, by an expert or by hand, whose successes are cut.
        uid: which of them (null: all; one is enough to be cut without its name).
        cuts: where it is cut, THING:FIRST-LAST in steps, in their order; found: where nothing was said; phases: as
            found, but at the nearest change of a phase (null: a person says it on a page).
        page: serve the page; else only print the cuts as they stand.
        port: of the page, on this machine alone; 0 for any that is free.
        open: open the page in a browser, where there is a screen.
    """

    dataset: str
    uid: str | None = None
    cuts: tuple[str, ...] | None = None
    page: bool = True
    port: int = 8645
    open: bool = True

    def __post_init__(self) -> None:
        at_least(self, port=0)


def segment(
    settings: Segmentation, opened: Callable[[SegmentServer], None] = lambda server: None
) -> dict[str, tuple[Cut, ...]]:
    """Cut a flight, or serve the page until interrupted, once ``opened`` was told where; return the cuts as they stand.

    Raises:
        InvalidValueError, UnknownNameError: there is no such flight, it cannot be cut so, or the port is taken.
    """
    from aerial_il.data.dataset import open_dataset
    from aerial_il.generation.moves import cuts_of
    from aerial_il.generation.source import source_of
    from aerial_il.workflows.parts.segment_server import SegmentServer

    dataset = open_dataset(settings.dataset)
    uids = dataset.uids if settings.uid is None else (settings.uid,)
    first = source_of(dataset, uids[0])
    if settings.cuts is not None:
        if len(uids) > 1:
            raise InvalidValueError(f"{settings.dataset} has {len(uids)} flights: say which, such as uid={uids[0]}.")
        set_cuts(settings.dataset, first, settings.cuts)
    elif settings.page:
        with SegmentServer(settings.dataset, uids, settings.port) as server:
            opened(server)
            server.serve_forever()
    return {uid: cuts_of(source_of(dataset, uid)) for uid in uids}
