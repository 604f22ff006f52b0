"""Where what is trained on lies: in memory up to a limit, beyond it in files that vanish with the arrays in them."""

import logging
import math
import mmap
import os
import shutil
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from aerial_il.core.computer import HELD_MB, free_memory_bytes
from aerial_il.core.errors import StorageError
from aerial_il.data.episode import Episode
from aerial_il.data.source import MEGABYTE

log = logging.getLogger(__name__)
BLOCK, LARGEST_FILE, ALIGNED = 1 << 26, 1 << 32, 64  # bytes
NOTHING = np.empty(0, np.uint8)
SHORT = "Name a disk with more room in TMPDIR, or take fewer episodes (dataset.episodes=N)."


class Memory:
    """Hands out arrays, of a process, that together take no more memory than a limit.

    Small ones share blocks; a block is given back when no array lies in it any more.
    """

    def __init__(self) -> None:
        self._limit, self._held, self._filed = HELD_MB * MEGABYTE, 0, 0
        self._rest = NOTHING
        self._files = weakref.WeakSet[mmap.mmap]()
        self._said, self._origin = False, dict[str, Any]()

    @contextmanager
    def limited(self, held_mb: int) -> Iterator[None]:
        """Hold at most ``held_mb`` within the context."""
        before, self._limit, self._said, self._filed = self._limit, held_mb * MEGABYTE, False, 0
        self._rest = NOTHING  # what is handed out from now on keeps to the new limit
        try:
            yield
        finally:
            self._limit, self._rest = before, NOTHING

    def room_bytes(self) -> int:
        """Return how much more there is room for, in memory and in files."""
        return min(max(self._limit - self._held, 0), free_memory_bytes()) + _free_on_disk()

    def empty(self, shape: tuple[int, ...], dtype: np.typing.DTypeLike) -> np.ndarray:
        """Return an array that is to be filled.

        Raises:
            StorageError: the disk has no room for it.
        """
        size = math.prod(shape) * np.dtype(dtype).itemsize
        taken = -(-size // ALIGNED) * ALIGNED
        if taken > len(self._rest):
            self._rest = self._block(max(taken, BLOCK if taken < BLOCK // 4 else 0))
        found, self._rest = self._rest[:size], self._rest[taken:] if taken < len(self._rest) else NOTHING
        return found.view(dtype).reshape(shape)

    def keep(self, episode: Episode) -> Episode:
        """Return the episode with its arrays here, each of them once, as are values that the one before had, too."""
        kept: dict[int, np.ndarray] = {}

        def moved(array: np.ndarray) -> np.ndarray:
            if id(array) not in kept:
                kept[id(array)] = self.empty(array.shape, array.dtype)
                kept[id(array)][...] = array
            return kept[id(array)]

        own = {name: moved(each) for name, each in vars(episode).items() if isinstance(each, np.ndarray)}
        obs, before = {name: moved(each) for name, each in episode.obs.items()}, self._origin
        self._origin = {k: before.get(k, v) if before.get(k, v) == v else v for k, v in episode.provenance.items()}
        return replace(episode, obs=obs, provenance=self._origin, **own)

    def _block(self, size: int) -> np.ndarray:
        if self._held + size > self._limit:
            return self._in_file(size)
        block = np.empty(size, np.uint8)
        self._held += size
        weakref.finalize(block, self._give_back, size)
        return block

    def _give_back(self, size: int) -> None:
        self._held -= size

    def _in_file(self, size: int) -> np.ndarray:
        size = max(size, min(self._filed, LARGEST_FILE, _free_on_disk() // 2))  # few files: each has a descriptor
        if not size:
            return NOTHING
        if not self._said:
            limit = f"{self._limit // MEGABYTE} MB of memory (dataset.held_mb=N for more)"
            log.info("What is trained on takes more than %s: the rest lies in files in %s.", limit, scratch_folder())
            self._said = True
        try:
            with tempfile.TemporaryFile(dir=scratch_folder()) as file:
                os.posix_fallocate(file.fileno(), 0, size)  # a full disk is an error now, and a crash later
                pages = mmap.mmap(file.fileno(), size)
        except OSError as error:
            raise StorageError(scratch_folder(), error, SHORT) from error
        for each in self._files:
            each.madvise(mmap.MADV_DONTNEED)  # their pages stay in the file, and need not in memory
        self._files.add(pages)
        self._filed += size
        return np.frombuffer(pages, np.uint8)


def scratch_folder() -> Path:
    """Where the files lie: on a disk, which /tmp may not be."""
    return Path(os.environ.get("TMPDIR") or "/var/tmp")


def _free_on_disk() -> int:
    """How many bytes files may take; none where there is no such folder, which matters only if they are needed."""
    try:
        return shutil.disk_usage(scratch_folder()).free
    except OSError:
        return 0


MEMORY = Memory()
