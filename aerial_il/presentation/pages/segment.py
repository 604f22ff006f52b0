"""A page on which a flight is watched above its time line, and a person says where it is cut."""

from __future__ import annotations

from collections.abc import Sequence

from aerial_il.presentation.pages.page import page_text


def segment_page(dataset: str, uids: Sequence[str]) -> str:
    """Return the page as a server hands it out.

    Args:
        dataset: as it is typed. uids: of the flights that can be cut.
    """
    return page_text("segment.html.j2", dataset=dataset, data=list(uids))
