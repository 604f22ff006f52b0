"""A file of preferences, one on each line of JSON: what was said stays, whatever kills the process afterwards."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aerial_il.core.bounded import parse_json, read_text
from aerial_il.core.errors import DemoError, InvalidValueError
from aerial_il.core.files import open_own
from aerial_il.core.places import MADE_BY, claim_file
from aerial_il.data.preferences.pairs import Preference, Segment

HEADER = {"made_by": MADE_BY, "preferences": 1}
MAKE = "Make one with: aerial-il prefer dataset=PATH pairs=200 out=FILE.jsonl"


def read_preferences(path: str | os.PathLike[str], lengths: Mapping[str, int] | None = None) -> list[Preference]:
    """Return the preferences of a file; a last line cut short by a kill is left out.

    Args:
        path: the file. lengths: uid -> steps of the episodes that they must be about; None for any.

    Raises:
        DemoError: there is no such file, a line of it is no preference, or one is about another dataset.
    """
    return [preference for preference, _ in _lines(Path(path), lengths)]


class PreferenceFile:
    """A file that preferences are added to; use it in a ``with`` block.

    Args:
        path: a new file, or one of preferences, which is gone on with. lengths: as of :func:`read_preferences`.

    Attributes:
        preferences: all that it holds.

    Raises:
        InvalidValueError: the place is somebody else's, or another process adds to it.
        DemoError: the file is damaged, or about another dataset.
        OSError: it cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str], lengths: Mapping[str, int]) -> None:
        path = claim_file(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = open_own(path)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            held = _lines(path, lengths) if path.stat().st_size else []
        except BlockingIOError:
            self._file.close()
            raise InvalidValueError(f"{path} is being added to by another process: wait for it.") from None
        except BaseException:
            self._file.close()
            raise
        self.preferences = [preference for preference, _ in held]
        self._file.truncate(held[-1][1] if held else 0)
        self._file.seek(0, os.SEEK_END)
        if not held:
            self._write(HEADER)
        elif not _ends_a_line(path):  # as an editor may leave it
            self._file.write(b"\n")

    def __enter__(self) -> PreferenceFile:
        return self

    def __exit__(self, *error: object) -> None:
        self._file.close()

    def add(self, preference: Preference) -> None:
        """Keep one more, on the disk before this returns."""
        self._write(_tree(preference))
        self.preferences.append(preference)

    def _write(self, tree: Mapping[str, Any]) -> None:
        self._file.write((json.dumps(tree) + "\n").encode())
        self._file.flush()
        os.fsync(self._file.fileno())


def _ends_a_line(path: Path) -> bool:
    return read_text(path).endswith("\n")


def _lines(path: Path, lengths: Mapping[str, int] | None) -> list[tuple[Preference, int]]:
    """Return each preference, and the number of bytes up to its end."""
    try:
        lines = read_text(path).splitlines(keepends=True)
    except FileNotFoundError as error:
        raise DemoError(path, "does not exist.", hint=MAKE) from error
    except (OSError, ValueError) as error:
        raise DemoError(path, f"cannot be read ({error}).", hint=MAKE) from error
    found, end = list[tuple[Preference, int]](), 0
    for number, line in enumerate(lines, start=1):
        end += len(line.encode())
        try:
            tree = parse_json(line)
        except ValueError as error:
            if not line.endswith("\n"):
                break  # cut short by a kill
            raise DemoError(path, f"line {number} cannot be used ({error}).", hint=MAKE) from error
        try:
            if number == 1:
                if tree != HEADER:
                    raise InvalidValueError(f"a file of preferences begins with {json.dumps(HEADER)}")
                continue
            preference = _preference(tree)
            if lengths is not None:
                _check(preference, lengths)
        except (ValueError, LookupError, TypeError) as error:
            raise DemoError(path, f"line {number} cannot be used ({error}).", hint=MAKE) from error
        found.append((preference, end))
    return found


def _check(preference: Preference, lengths: Mapping[str, int]) -> None:
    """Refuse segments that no episode has."""
    for uid, first, length in preference.pair:
        if uid not in lengths:
            raise InvalidValueError(f"the dataset has no episode {uid}: it was made for another one")
        if first + length > lengths[uid]:
            raise InvalidValueError(f"episode {uid} has {lengths[uid]} steps, and {first + length} are named")


def _tree(preference: Preference) -> dict[str, Any]:
    sides = {name: getattr(preference, name)._asdict() for name in ("left", "right")}
    return {**sides, "preferred": preference.preferred, "by": preference.by}


def _preference(tree: Any) -> Preference:
    left, right = (_segment(tree[name]) for name in ("left", "right"))
    return Preference(left, right, tree["preferred"], tree["by"])


def _segment(tree: Any) -> Segment:
    segment = Segment(tree["uid"], tree["first"], tree["length"])
    if not (isinstance(segment.uid, str) and type(segment.first) is type(segment.length) is int):
        raise InvalidValueError(f"{tree} is not a segment")
    return segment
