"""Edits of a dataset's own folder that can be taken back: episodes deleted, recorded anew with other labels, or marked.

Before anything changes, ``trash/N/edit.json`` says what is going to. Then the index leaves the episodes out, and
their files go to ``trash/N/``, one rename each, so that what a killed process leaves is known, and the next edit
finishes it. Taking an edit back is the same way backwards; what is brought back are the very files.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from aerial_il.core.bounded import read_json
from aerial_il.core.errors import DemoError, InvalidValueError
from aerial_il.core.files import sha256_of, sync_folder, write_json
from aerial_il.core.progress import Progress
from aerial_il.core.specs import EnvSpec
from aerial_il.data.curation.relabelling import Labels, relabel
from aerial_il.data.folder import DEMOS, FAILURES, INDEX, KINDS, DatasetFolder
from aerial_il.data.recording.reader import read_head
from aerial_il.data.recording.scan import scan
from aerial_il.data.recording.writer import part_of, storing
from aerial_il.data.table import FURTHER, read_columns, write_column

TRASH, NOTE = "trash", "edit.json"
State = Literal["started", "done", "undoing"]


@dataclass(frozen=True)
class Moved:
    """One episode of an edit: the folder it was in, the SHA-256 that the index listed, and the folder it goes to."""

    kind: str
    sha256: str
    to: str | None


@dataclass(frozen=True)
class Marks:
    """Values of a further column: uid -> as it was, and as it is said; None for none."""

    column: str
    before: Mapping[str, Any]
    after: Mapping[str, Any]


@dataclass(frozen=True)
class Edit:
    """One edit as its note says it.

    Attributes:
        number: of the edits, from 1 on. state: how far it is. where: which episodes were asked for.
        labels: what they are given; None where they are deleted, or marked. episodes: by uid, those that are moved.
        marks: what is said of them instead; None where they are deleted or relabelled.
    """

    number: int
    state: State
    where: str
    labels: Labels | None
    episodes: Mapping[str, Moved] = field(repr=False)
    marks: Marks | None = None

    @property
    def count(self) -> int:
        """Number of the episodes that it is about."""
        return len(self.episodes if self.marks is None else self.marks.after)

    @property
    def what(self) -> str:
        """What was done to them, in a word or two."""
        if self.marks is not None:
            return f"given other {self.marks.column}"
        return "deleted" if self.labels is None else "relabelled"

    @property
    def asked(self) -> tuple[str, Labels | None]:
        """What tells a command from another."""
        return self.where, self.labels

    @staticmethod
    def read(path: Path) -> Edit:
        """Read the note ``path``.

        Raises:
            DemoError: it is none of ours.
        """
        try:
            raw = read_json(path)
            episodes = {uid: Moved(**moved) for uid, moved in raw["episodes"].items()}
            labels = None if raw["labels"] is None else Labels(**raw["labels"])
            kinds = {kind for each in episodes.values() for kind in (each.kind, each.to) if kind is not None}
            if raw["state"] not in ("started", "done", "undoing") or not kinds <= {*KINDS}:
                raise ValueError("its state or its folders are none")
            if labels is not None:
                labels.require_types()
            said = raw.get("marks")
            marks = Marks(str(said["column"]), dict(said["before"]), dict(said["after"])) if said else None
            return Edit(int(path.parent.name), raw["state"], str(raw["where"]), labels, episodes, marks)
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise DemoError(path, f"is no note of an edit ({error}).") from error


class Edits:
    """The edits of one dataset folder; one process at a time.

    Args:
        folder: of recordings. progress: show progress bars.
    """

    def __init__(self, folder: DatasetFolder, *, progress: bool = False) -> None:
        self.folder, self._progress = folder, progress

    @staticmethod
    @contextmanager
    def of(path: str | os.PathLike[str], *, progress: bool = False) -> Iterator[Edits]:
        """Open the edits of a dataset folder, which must be ours, for this process alone.

        Raises:
            InvalidValueError: it is no folder of recordings, somebody else's, or another process edits it.
        """
        folder = DatasetFolder(path)
        if not ((folder.path / INDEX).exists() or (folder.path / DEMOS).is_dir()):
            raise InvalidValueError(f"{path} is no dataset folder of recordings, and nothing else can be edited.")
        folder.require_own()
        for name in (TRASH, FURTHER, *KINDS):
            if (folder.path / name).is_symlink():
                raise InvalidValueError(f"{folder.path / name} is a link; nothing is moved through it.")
        with folder.alone():
            yield Edits(folder, progress=progress)

    def last(self) -> Edit | None:
        """Return the last edit that was not taken back."""
        notes = (self.folder.path / TRASH).glob(f"*/{NOTE}")
        numbers = [int(note.parent.name) for note in notes if note.parent.name.isdecimal()]
        if not numbers:
            return None
        place = self._place(max(numbers))
        if link := next((each for each in (place, *(place / kind for kind in KINDS)) if each.is_symlink()), None):
            raise InvalidValueError(f"{link} is a link; nothing is moved through it.")
        return Edit.read(place / NOTE)

    def finish(self) -> Edit | None:
        """Bring what a killed process left of an edit to its end; return the edit, if there was one."""
        edit = self.last()
        if edit is None or edit.state == "done":
            return None
        return self._forwards(edit) if edit.state == "started" else self._backwards(edit)

    def make(self, uids: Iterable[str], where: str, labels: Labels | None = None) -> Edit:
        """Delete episodes, or give them labels.

        Args:
            uids: of the folder. where: how they were asked for. labels: None to delete them.
        """
        index, moved = self.folder.read_index(), dict[str, Moved]()
        for uid in uids:
            file = self.folder.find(uid)
            assert file is not None
            kind, to = file.parent.name, labels and labels.kind(file.parent.name)
            if to not in (None, kind) and self.folder.file(uid, str(to)).exists():
                raise InvalidValueError(f"{self.folder.path} has {uid} among its successes and its failures, too.")
            moved[uid] = Moved(kind, index.get(kind, {}).get(uid, ""), to)
        return self._begun(where, labels, moved)

    def mark(self, column: str, values: Mapping[str, Any], where: str) -> Edit:
        """Give a further column other values.

        Args:
            column: its name. values: uid -> a plain value, or None for none. where: how they were asked for.
        """
        known = read_columns(self.folder.path).get(column, {})
        return self._begun(where, None, {}, Marks(column, {uid: known.get(uid) for uid in values}, values))

    def undo(self) -> Edit:
        """Take the last edit back.

        Raises:
            InvalidValueError: there is none.
        """
        edit = self.last()
        if edit is None:
            raise InvalidValueError(f"{self.folder.path} has no edit to take back.")
        if edit.labels is None:
            for uid, moved in edit.episodes.items():
                self._require_free(*self._places(edit, uid, moved))
        edit = replace(edit, state="undoing")
        self._note(edit)
        return self._backwards(edit)

    def _places(self, edit: Edit, uid: str, moved: Moved) -> tuple[Path, Path]:
        """Return where an episode is kept since an edit, and where it was."""
        return self._place(edit.number) / moved.kind / f"{uid}.mcap", self.folder.file(uid, moved.kind)

    def _require_free(self, kept: Path, home: Path) -> None:
        """Refuse to bring an episode back to where another one was recorded since; the same one may be there."""
        if kept.exists() and home.exists() and sha256_of(kept) != sha256_of(home):
            raise InvalidValueError(f"{home} was recorded anew since {kept} was deleted: move one of them away.")

    def _begun(
        self, where: str, labels: Labels | None, episodes: Mapping[str, Moved], marks: Marks | None = None
    ) -> Edit:
        last = self.last()
        edit = Edit(1 if last is None else last.number + 1, "started", where, labels, episodes, marks)
        self._note(edit)
        return self._forwards(edit)

    def _forwards(self, edit: Edit) -> Edit:
        if edit.marks is None:
            self._put_away(edit)
        else:
            self._say(edit.marks.column, edit.marks.after)
        done = replace(edit, state="done")
        self._note(done)
        return done

    def _put_away(self, edit: Edit) -> None:
        spec, place = self._spec(edit), self._place(edit.number)
        self.folder.write_index(spec, leaving=edit.episodes.keys())
        for uid, moved in self._shown(edit, "delete" if edit.labels is None else "relabel"):
            kept = place / moved.kind / f"{uid}.mcap"
            if not kept.exists():
                _move(self.folder.file(uid, moved.kind), kept)
            if edit.labels is not None and moved.to and not (target := self.folder.file(uid, moved.to)).exists():
                relabel(kept, target, edit.labels, edit.where, part=self.folder.file(uid, DEMOS))
        self._sync(place)
        self.folder.write_index(spec)

    def _backwards(self, edit: Edit) -> Edit:
        if edit.marks is None:
            self._bring_back(edit)
        else:
            self._say(edit.marks.column, edit.marks.before)
        place = self._place(edit.number)
        (place / NOTE).unlink()
        for folder in (*(place / kind for kind in KINDS), place, place.parent):
            with suppress(OSError):  # something else lies there
                folder.rmdir()
        return edit

    def _say(self, column: str, values: Mapping[str, Any]) -> None:
        """Give a column other values, where they are None none."""
        said = {**read_columns(self.folder.path).get(column, {}), **values}
        kept = {uid: value for uid, value in said.items() if value is not None}
        with storing(self.folder.path / FURTHER):
            written = write_column(self.folder.path, column, kept)
            if not kept:
                written.unlink()

    def _bring_back(self, edit: Edit) -> None:
        spec, place = self._spec(edit), self._place(edit.number)
        self.folder.write_index(spec, leaving=edit.episodes.keys())
        for uid, moved in self._shown(edit, "undo"):
            kept, home = self._places(edit, uid, moved)
            if kept.exists():
                if edit.labels is None:
                    self._require_free(kept, home)
                _move(kept, home)
                os.utime(home)  # what was derived in the meantime is older
            if moved.to is not None:
                part_of(self.folder.file(uid, DEMOS)).unlink(missing_ok=True)
            if moved.to not in (None, moved.kind):
                self.folder.file(uid, str(moved.to)).unlink(missing_ok=True)
        self._sync(place)
        self.folder.write_index(spec, {uid: moved.sha256 for uid, moved in edit.episodes.items() if moved.sha256})

    def _spec(self, edit: Edit) -> EnvSpec:
        """Return the specification of the folder, or of one of its episodes where it has no index."""
        if (spec := self.folder.spec()) is not None:
            return spec
        places = (self.folder.path, self._place(edit.number))
        file = next(file for place in places for kind in KINDS for file in (place / kind).glob("*.mcap"))
        return read_head(file, scan(file)).layout.spec

    def _shown(self, edit: Edit, what: str) -> Iterable[tuple[str, Moved]]:
        return Progress(edit.episodes.items(), desc=what, unit="ep", disable=not self._progress)

    def _place(self, number: int) -> Path:
        return self.folder.path / TRASH / f"{number:04d}"

    def _note(self, edit: Edit) -> None:
        path = self._place(edit.number) / NOTE
        with storing(path):
            write_json(path, {"made_by": "aerial_il", **asdict(edit)})

    def _sync(self, place: Path) -> None:
        folders = (home / kind for home in (self.folder.path, place) for kind in (DEMOS, FAILURES))
        for folder in filter(Path.is_dir, folders):
            sync_folder(folder)


def _move(file: Path, target: Path) -> None:
    with storing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        os.replace(file, target)
