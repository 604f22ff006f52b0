"""Files that are either whole or absent, whatever kills the process in between."""

import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import yaml

from aerial_il.core.bounded import open_regular


class PlainDumper(yaml.SafeDumper):
    """Writes what occurs twice twice: readers refuse aliases, by which a few lines can stand for gigabytes."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def write_atomic(path: str | os.PathLike[str], content: bytes | str) -> Path:
    """Write ``content`` to ``path`` so that a reader sees the old file or the new one, never a part.

    Args:
        path: destination; missing parent folders are made.
        content: bytes, or text encoded as UTF-8.

    Returns:
        The path written.

    Raises:
        OSError: the disk is full or the folder not writable; it names ``path``, and the old file is untouched.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    with writing(path, temporary):
        with open(temporary, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    sync_folder(path.parent)
    return path


@contextmanager
def writing(path: Path, part: Path) -> Iterator[None]:
    """Write ``path`` by way of ``part``: what fails leaves nothing, and an error of the system's names ``path``.

    Of a full disk the system says what happened, but not to which file.
    """
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
    finally:
        part.unlink(missing_ok=True)


def write_json(path: str | os.PathLike[str], tree: Any) -> Path:
    """Write ``tree`` as indented JSON, atomically. NaN and infinity are refused."""
    return write_atomic(path, json.dumps(tree, indent=2, allow_nan=False) + "\n")


def open_own(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a file of a folder for appending; a link, by which a folder could have another written, is refused.

    Raises:
        OSError: it is a link or cannot be written.
    """
    return open(os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666), "ab")


def sync_folder(folder: str | os.PathLike[str]) -> None:
    """Make renames and new names in ``folder`` durable."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def sha256_of(path: str | os.PathLike[str]) -> str:
    """Return the hexadecimal SHA-256 of a regular file; of no other, since a device never ends."""
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
