"""Demonstrations for the commands that learn from them."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice

import aerial_il
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode


def demonstrations(path: str, *, limit: int | None) -> Iterable[Episode]:
    """Open a dataset and, where ``limit`` says so, take its first successful episodes only.

    Raises:
        InvalidValueError: there are fewer of them than ``limit``.
    """
    dataset = aerial_il.open_dataset(path)
    if limit is None:
        return dataset
    chosen = list(islice((episode for episode in dataset if episode.success), limit))
    if len(chosen) < limit:
        raise InvalidValueError(
            f"{path} has {len(chosen)} successful demonstrations; dataset.episodes={limit} asks for more. "
            "Collect more into it, or leave dataset.episodes=null for all."
        )
    return chosen
