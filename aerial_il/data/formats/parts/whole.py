"""Files and folders that appear whole or not at all."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from aerial_il.core.files import sync_folder
from aerial_il.data.recording.writer import storing

SPARE = 4 << 20  # bytes, of what HDF5 writes of its own


def require_room(path: Path, size: int) -> None:
    """Require that ``size`` more bytes can be written beside ``path``: HDF5 does not survive a disk that fills up.

    Raises:
        OSError: they cannot.
    """
    with tempfile.TemporaryFile(dir=path.parent) as scratch:
        os.posix_fallocate(scratch.fileno(), 0, size + SPARE)


@contextmanager
def replacing(out: Path) -> Iterator[Path]:
    """Name a place beside ``out`` to be written to, which takes the place of ``out`` when all went well.

    Raises:
        StorageError: the disk is full or the folder not writable.
    """
    temporary = out.with_name(f".{out.name}.{os.getpid()}.tmp")
    try:
        with storing(out):
            out.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            _take_the_place(temporary, out)
            sync_folder(out.parent)
    finally:
        temporary.unlink(missing_ok=True) if temporary.is_file() else shutil.rmtree(temporary, ignore_errors=True)


def _take_the_place(new: Path, out: Path) -> None:
    """Put ``new`` where ``out`` is: interrupted at any moment, one of them is there whole."""
    if not (new.is_dir() and out.exists()):
        os.replace(new, out)
        return
    old = new.with_suffix(".old")
    os.replace(out, old)
    os.replace(new, out)
    shutil.rmtree(old, ignore_errors=True)
