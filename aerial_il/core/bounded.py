"""Read bytes, JSON and YAML that somebody else may have written: what they cost is bounded before they are unpacked.

Whatever is refused is a ``ValueError``, as are JSON and YAML that say nothing; callers name the file and what to do.
"""

import errno
import io
import json
import os
import re
import stat
import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from aerial_il.core.errors import InvalidValueError

MAX_TEXT_BYTES = 96 << 20
MAX_JSON_VALUES = 4_000_000  # an empty list takes 3 bytes of a file and 70 of memory
MAX_YAML_EVENTS = 600_000  # 2 s and 200 MB
MAX_DEPTH = 100
MAX_UNPACKED_BYTES = 200 << 20
_LONG_NUMBER = re.compile(r"[-+0-9_:.]{300,}")  # base 60 takes the square of its length


def read_bytes(path: str | os.PathLike[str], *, most: int) -> bytes:
    """Read a regular file of at most ``most`` bytes; a pipe or a device, which may never end, is refused.

    Raises:
        OSError: it cannot be read.
        InvalidFileError: it is larger, or no file.
    """
    with open_regular(path) as file:
        if (size := os.fstat(file.fileno()).st_size) > most:
            raise InvalidFileError(f"it has {size} bytes, more than {most}")
        return file.read(size)


def open_regular(path: str | os.PathLike[str]) -> io.BufferedReader:
    """Open a regular file for reading; raises as :func:`read_bytes`."""
    file = open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb")  # noqa: SIM115 - a pipe would wait
    mode = os.fstat(file.fileno()).st_mode
    if stat.S_ISREG(mode):
        return file
    file.close()
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    raise InvalidFileError(f"{path} is not a regular file")


def read_text(path: str | os.PathLike[str]) -> str:
    """Read a text of at most ``MAX_TEXT_BYTES``; raises as :func:`read_bytes` and for what is not UTF-8."""
    return read_bytes(path, most=MAX_TEXT_BYTES).decode()


def read_json(path: str | os.PathLike[str]) -> Any:
    """Read a JSON file; raises as :func:`read_text` and :func:`parse_json`."""
    return parse_json(read_text(path))


def parse_json(text: str | bytes) -> Any:
    """Return what a JSON text says.

    Raises:
        ValueError: it is none, or has more values or is nested deeper than any of ours.
    """
    text = text.decode() if isinstance(text, bytes) else text
    if (count := sum(map(text.count, ",[{"))) > MAX_JSON_VALUES:
        raise InvalidFileError(f"it has {count} values, more than {MAX_JSON_VALUES}")
    try:
        return json.loads(text)
    except RecursionError:
        raise InvalidFileError("it is nested too deep") from None


def read_yaml(path: str | os.PathLike[str]) -> Any:
    """Read a YAML file; raises as :func:`read_text` and :func:`parse_yaml`."""
    return parse_yaml(Path(path), read_text(path))


def parse_yaml(name: object, text: str | bytes) -> Any:
    """Return what the YAML text of the file ``name`` says, in plain values.

    Raises:
        ValueError: it is none, or it has an alias, a tag, too much in it or too deep.
    """
    import yaml  # an exported policy flies without

    try:
        _check_events(text)
        return yaml.load(text, Loader=yaml.CSafeLoader)
    except (yaml.YAMLError, RecursionError, OverflowError) as error:
        raise InvalidFileError(f"{name} is not valid YAML: {error}") from error


def _check_events(text: str | bytes) -> None:
    """Refuse what would grow: an alias can double at every line, and a tag can ask for another type."""
    import yaml

    depth = 0
    for number, event in enumerate(yaml.parse(text, Loader=yaml.CSafeLoader)):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if number > MAX_YAML_EVENTS or depth > MAX_DEPTH:
            raise InvalidFileError(f"it has more than {MAX_YAML_EVENTS} values, or is nested deeper than {MAX_DEPTH}")
        if isinstance(event, yaml.AliasEvent):
            raise InvalidFileError(f"it has an alias, *{event.anchor}, which nothing written here has")
        if getattr(event, "tag", None) is not None:
            raise InvalidFileError(f"it has a tag, {event.tag}, which nothing written here has")
        if isinstance(event, yaml.ScalarEvent) and event.implicit[0] and _LONG_NUMBER.fullmatch(event.value):
            raise InvalidFileError(f"it has a number of {len(event.value)} digits")


def read_npz(
    path: str | os.PathLike[str], names: Collection[str] | None = None, *, most: int = MAX_UNPACKED_BYTES
) -> dict[str, np.ndarray]:
    """Read the arrays of an ``.npz`` file, all or those of ``names`` that are there; objects are refused.

    Raises:
        OSError: it cannot be read.
        ValueError: it is none, or would unpack to more than ``most`` bytes.
    """
    raw = io.BytesIO(read_bytes(path, most=most))
    try:
        with zipfile.ZipFile(raw) as archive:
            if (size := sum(entry.file_size for entry in archive.infolist())) > most:
                raise InvalidFileError(f"it would unpack to {size} bytes, more than {most}")
        with np.load(raw, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files if names is None or name in names}
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, MemoryError, NotImplementedError, KeyError) as error:
        raise InvalidFileError(f"it is no file of arrays: {error!r}") from error


class InvalidFileError(InvalidValueError):
    """A file that asks for more than any of ours would, or is none."""
