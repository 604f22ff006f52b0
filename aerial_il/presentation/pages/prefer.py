"""A page on which two segments of flights are watched side by side, and the better one is chosen by a key."""

from collections.abc import Mapping
from typing import Any

from aerial_il.presentation.pages.page import page_text


def prefer_page(dataset: str, state: Mapping[str, Any]) -> str:
    """Return the page as a server hands it out.

    Args:
        dataset: as it is typed. state: ``left``, the next pairs' numbers, ``said``, how many have an answer, ``pairs``.
    """
    return page_text("prefer.html.j2", dataset=dataset, data=state)
