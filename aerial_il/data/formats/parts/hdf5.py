"""HDF5 without trust: opened after the probe, its links and sizes looked at before anything is read.

A format recognises its files by :func:`holds`, which never follows a link out of the file.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from aerial_il.core.errors import AerialError, DemoError
from aerial_il.data.formats.parts.hdf5_probe import require_readable
from aerial_il.data.source import Later

ENDINGS = (".hdf5", ".h5")
FAULTS = (
    OSError, LookupError, ArithmeticError, RuntimeError, ValueError, TypeError, AttributeError, MemoryError, AerialError
)  # fmt: skip


def holds(path: Path, *places: str) -> bool:
    """Return whether a file ends as those of HDF5 do and has all of some places, such as ``data/*/actions``.

    Raises:
        DemoError: it is damaged.
    """
    if path.suffix not in ENDINGS or path.is_dir():
        return False
    with opened(path, "cannot be read as HDF5") as file:
        return all(_holds(file, place.split("/")) for place in places)


@contextmanager
def opened(path: Path, problem: str) -> Iterator[h5py.File]:
    """Open a file that the library comes back from.

    Raises:
        DemoError: it does not, or anything goes wrong before the file is closed; it then says the ``problem``.
    """
    require_readable(path)
    try:
        with h5py.File(path, "r") as file:
            yield file
    except DemoError:
        raise
    except FAULTS as error:
        raise DemoError(path, f"{problem} ({error}).") from error


def numbered(names: Iterable[str]) -> list[str]:
    """Return names in the order of the numbers that they end in: ``demo_10`` comes after ``demo_9``."""
    return sorted(names, key=lambda name: (len(name), name))


def array(path: Path, group: h5py.Group, name: str) -> np.ndarray:
    """Return a dataset (T, ...)."""
    return rows(path, group, name)[()]


def later(path: Path, group: h5py.Group, name: str) -> Later:
    """Return a dataset (T, ...) that is read when it is used: only then is it known whether there is room for it."""
    dataset, place, file_path = rows(path, group, name), str(group.name), Path(group.file.filename)

    def load(chosen: slice) -> np.ndarray:
        with opened(file_path, f"has unreadable data in {place}/{name}") as file:
            return rows(path, file if place == "/" else child(path, file, place, h5py.Group), name)[chosen]

    return Later(dataset.shape, dataset.dtype, load)


def rows(path: Path, group: h5py.Group, name: str) -> h5py.Dataset:
    """Return a dataset of rows of numbers, unread."""
    dataset = child(path, group, name, h5py.Dataset)
    if dataset.dtype.kind not in "biuf" or dataset.shape is None or not dataset.shape:
        raise DemoError(path, f"has no rows of numbers in {dataset.name}.", got=(dataset.dtype, dataset.shape))
    return dataset


def child(path: Path, group: h5py.Group, name: str, kind: type) -> Any:
    """Return a child that lies in the file itself."""
    link = group.get(name, getlink=True)
    if link is None:
        raise DemoError(path, f"lacks {group.name}/{name}.", got=sorted(group))
    if not isinstance(link, h5py.HardLink):
        raise DemoError(path, f"refers to a place outside itself: {group.name}/{name}.")
    found = group[name]
    if not isinstance(found, kind):
        raise DemoError(path, f"has no {kind.__name__.lower()} {found.name}.")
    if isinstance(found, h5py.Dataset) and (found.external or found.is_virtual):
        raise DemoError(path, f"refers to a place outside itself: {found.name}.")
    return found


def _holds(group: h5py.Group, names: list[str]) -> bool:
    for name in group if names[0] == "*" else names[:1]:
        link = group.get(name, getlink=True)
        if len(names) == 1 and link is not None:
            return True
        if (
            isinstance(link, h5py.HardLink)
            and isinstance(found := group[name], h5py.Group)
            and _holds(found, names[1:])
        ):
            return True
    return False
