"""Episodes to inspect: those of whatever was named, with their pictures."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from aerial_il.core.errors import DemoError
from aerial_il.data.dataset import Dataset, open_dataset
from aerial_il.data.episode import Episode


def open_source(path: str | os.PathLike[str]) -> Dataset:
    """Open recordings, a LeRobot folder or an HDF5 file, failures and pictures included.

    Raises:
        DemoError: there is no such thing, or nothing in it.
    """
    return open_dataset(Path(path), cameras=True, failures=True)


def chosen(dataset: Dataset, episode: int | None, most: int) -> Iterator[Episode]:
    """Yield the episode of an index, negative from the end, or the first ``most`` of all.

    Raises:
        DemoError: the index is out of range.
    """
    count = len(dataset)
    if episode is None:
        yield from dataset.only(dataset.uids[:most])
    elif -count <= episode < count:
        yield dataset[episode]
    else:
        hint = f"List them with: aerial-il info {dataset.path}"
        raise DemoError(
            dataset.path, f"has no episode {episode}.", expected=f"0 to {count - 1}", got=episode, hint=hint
        )
