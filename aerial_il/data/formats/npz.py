"""Transitions as ``.npz``, as ``imitation`` and scripts keep them; names as :mod:`.parts.transitions` lists them."""

from pathlib import Path

from aerial_il.core.bounded import read_npz
from aerial_il.core.errors import DemoError
from aerial_il.data.formats.parts.transitions import KNOWN, source_of
from aerial_il.data.source import MEGABYTE, Source, Wanted


def recognises(path: Path) -> bool:
    return path.suffix == ".npz"


def read(path: Path, wanted: Wanted) -> Source:
    try:
        arrays = read_npz(path, KNOWN, most=wanted.memory_mb * MEGABYTE)
    except (OSError, ValueError) as error:
        hint = "Allow for more with memory_mb=N." if "more than" in str(error) else ""
        raise DemoError(path, f"cannot be read as transitions ({error}).", hint=hint) from error
    return source_of(path, arrays)
