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
            if temporary.is_dir():
                old = temporary.with_suffix(".old")
                put_in_place(temporary, out, old)
                shutil.rmtree(old, ignore_errors=True)
            else:
                os.replace(temporary, out)
                sync_folder(out.parent)
    finally:
        temporary.unlink(missing_ok=True) if temporary.is_file() else shutil.rmtree(temporary, ignore_errors=True)


def put_in_place(new: Path, out: Path, aside: Path) -> None:
    """Put a folder where ``out`` is, which goes ``aside``: whenever it is interrupted, each is somewhere whole."""
    if out.exists():
        os.replace(out, aside)
    os.replace(new, out)
    sync_folder(out.parent)
