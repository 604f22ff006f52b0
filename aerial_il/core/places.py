"""May an output go there? What is new, empty or ours may be written; everything else is refused by name.

A file is ours if it carries our name near its beginning or its end, which everything that is written here does; a
folder, if it has a file by which we know it and nothing besides what we put there.
"""

import os
from collections.abc import Sequence
from pathlib import Path

from aerial_il.core.errors import InvalidValueError

MADE_BY = "aerial_il"  # what pictures, films and tables say of who made them
NAMES = (MADE_BY.encode(), b"aerial-il")
SIGNS = {  # by name or ending, what a file of ours carries; any other is not ours
    ".html": (b'<meta name="generator" content="aerial_il">',),
    ".svg": (b"<dc:title>aerial_il</dc:title>",),
    "provenance.json": (b'"seal"', *NAMES),
    **dict.fromkeys((".hdf5", ".rrd", ".mcap", ".part", ".png", ".webp", ".mp4", ".json", ".jsonl"), NAMES),
    **dict.fromkeys(("objects.inv", "index.md", "README.md"), NAMES),  # of our documentation
}
README_SIGN = b"# Written by aerial-il card, which writes it anew: take this line out to keep your own words."
ANYTHING = ("**/*",)
JOB_LOG = "job.log"  # of a launcher
SEARCHED = 1 << 17  # bytes, from either end
LEFT_ALONE = "Nothing of it is changed. Choose another place with {key}=..., or move it away."


def claim_file(path: str | os.PathLike[str], *, key: str = "out", sign: bytes | None = None) -> Path:
    """Return the place of a file that is to be written, with what is there already being nobody else's.

    Args:
        key: how the place was named, for the words of a refusal.
        sign: what a file of ours carries, instead of what its name or ending says.

    Raises:
        InvalidValueError: it is a folder, a link, or a file that was not written here.
    """
    path = Path(path)
    if path.is_symlink():
        _refuse(key, path, f"is a link to {os.readlink(path)}")
    if path.is_dir():
        _refuse(key, path, "is a folder, and what is written is one file")
    if path.exists() and not is_ours(path, sign):
        _refuse(key, path, "exists, and was not written by aerial_il")
    _require_parent(key, path)
    return path


def claim_folder(
    path: str | os.PathLike[str], known_by: Sequence[str], parts: Sequence[str] = ANYTHING, *, key: str = "out"
) -> Path:
    """Return the place of a folder that is to be written into, or replaced.

    Args:
        known_by: patterns of files by which a folder of this kind is known as ours: one of them carries our name.
        parts: patterns of all that may lie there; to be given where the whole folder is replaced.
        key: as in :func:`claim_file`.

    Raises:
        InvalidValueError: it is a file, holds what was not written here, or is a link that would be replaced.
    """
    path = Path(path)
    if path.is_symlink() and parts != ANYTHING:
        _refuse(key, path, f"is a link to {os.readlink(path)}")
    if path.exists() and not path.is_dir():
        _refuse(key, path, "is a file, and what is written is a folder")
    _require_parent(key, path)
    if not path.exists() or not any(_counts(entry.name, parts) for entry in path.iterdir()):
        return path
    if not any(is_ours(file) for name in known_by for file in path.glob(name)):
        _refuse(key, path, "is not empty, and was not written by aerial_il")
    kept = {file for part in parts for file in path.glob(part)}
    if others := sorted(file for file in path.rglob("*") if not file.is_dir() and file not in kept):
        _refuse(key, others[0], "lies there too, and was not written by aerial_il")
    return path


def _counts(name: str, parts: Sequence[str]) -> bool:
    """Return whether an entry makes a folder somebody's; notes of who called us do not, where nothing is replaced."""
    return parts != ANYTHING or not (name.startswith(".") or name == JOB_LOG)


def is_ours(file: Path, sign: bytes | None = None) -> bool:
    """Whether a file was written here, or is empty; ``sign`` as in :func:`claim_file`."""
    if not file.is_file():
        return False
    with open(file, "rb") as raw:
        size = os.fstat(raw.fileno()).st_size
        head = raw.read(SEARCHED)
        raw.seek(max(0, size - SEARCHED))
        seen = head + raw.read(SEARCHED)
    signs = (sign,) if sign else SIGNS.get(file.name) or SIGNS.get(file.suffix.lower(), ())
    return not size or any(sign in seen for sign in signs)


def _require_parent(key: str, path: Path) -> None:
    """Require that what the place lies in is, or can become, folders."""
    for parent in path.absolute().parents:
        if parent.is_dir():
            return
        if parent.exists() or parent.is_symlink():
            raise InvalidValueError(f"{key}={path}: {parent} is not a folder. Choose another place with {key}=....")


def _refuse(key: str, path: Path, why: str) -> None:
    raise InvalidValueError(f"{key}: {path} {why}. {LEFT_ALONE.format(key=key)}")
