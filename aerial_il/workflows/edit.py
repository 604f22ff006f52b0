"""Edit the episodes of a dataset where they lie: delete some, correct their labels, cut them, take it back."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from aerial_il.core.errors import InvalidValueError

if TYPE_CHECKING:
    from aerial_il.data.curation.edits import Edit, Edits
    from aerial_il.data.curation.relabelling import Labels
    from aerial_il.generation.source import Source

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Delete:
    """What is deleted.

    Attributes:
        dataset: folder of recordings.
        where: condition on an episode's columns in aerial-il info, or on its provenance.
        progress: show a progress bar.
    """

    dataset: str
    where: str
    progress: bool = True


@dataclass(frozen=True, kw_only=True)
class Relabel:
    """What is said anew, and of which episodes.

    Attributes:
        dataset: folder of recordings.
        where: condition on an episode's columns in aerial-il info, or on its provenance.
        success: whether they are successes (null: as it was).
        operator: name of the person who flew them (null: as it was).
        instruction: what was to be done, in a sentence (null: as it was).
        tag: a word of your own (null: as it was).
        progress: show a progress bar.
    """

    dataset: str
    where: str
    success: bool | None = None
    operator: str | None = None
    instruction: str | None = None
    tag: str | None = None
    progress: bool = True


@dataclass(frozen=True, kw_only=True)
class Undo:
    """Where the last edit is taken back.

    Attributes:
        dataset: folder of recordings.
        progress: show a progress bar.
    """

    dataset: str
    progress: bool = True


def delete(settings: Delete) -> Edit:
    """Move episodes to the trash of their folder, and return what was done.

    Raises:
        InvalidValueError: the condition holds for none, or the folder is not ours. UnknownNameError: there is no such
            column. StorageError: the disk is full; the same call again goes on.
    """
    return _edit(settings, None)


def relabel(settings: Relabel) -> Edit:
    """Give episodes other labels, keeping what was said of them, and return what was done.

    Raises:
        InvalidValueError: nothing is given, or an operator to what no person flew; and as :func:`delete`.
    """
    return _edit(settings, _labels(settings))


def undo(settings: Undo) -> Edit:
    """Take the last deletion, relabelling or marking back, and return what it was."""
    from aerial_il.data.curation.edits import Edits

    with Edits.of(settings.dataset, progress=settings.progress) as edits:
        edit = edits.undo()
        _log(edits, "undo", edit)
        return edit


def set_cuts(dataset: str, source: Source, words: Sequence[str]) -> Edit:
    """Keep where a flight is to be cut for ``aerial-il generate``, and return what was done.

    Args:
        dataset: folder of recordings. source: one of its flights. words: its cuts as they are typed; ``phases``, as
            found, at the nearest change of a phase; or ``found``.

    Raises:
        InvalidValueError, UnknownNameError: it cannot be cut so, or the folder is not ours.
    """
    from aerial_il.data.curation.edits import Edits
    from aerial_il.generation.cuts import COLUMN, text_of
    from aerial_il.generation.moves import read_cuts

    cuts = None if list(words) == ["found"] else text_of(read_cuts(source, words))
    with Edits.of(dataset) as edits:
        edits.finish()
        edit = edits.mark(COLUMN, {source.uid: cuts}, f"uid == {source.uid!r}")
        _log(edits, "segment", edit)
        return edit


def undo_cuts(dataset: str) -> Edit:
    """Take the last edit of a dataset back if it was one of cuts, and return what it was."""
    from aerial_il.data.curation.edits import Edits

    with Edits.of(dataset) as edits:
        last = edits.last()
    if last is not None and last.marks is None:
        what = f"{last.count} episodes were {last.what}"
        raise InvalidValueError(f"The last edit is no cut: {what}. Take it back: aerial-il undo {dataset}")
    return undo(Undo(dataset=dataset, progress=False))


def edit_marked(dataset: str, *, what: str, uids: Sequence[str] = (), labels: Mapping[str, Any] | None = None) -> str:
    """Edit episodes that were marked on a page, and say what was done.

    Args:
        dataset: folder of recordings. what: delete, relabel or undo. uids: of the episodes. labels: to give them.

    Raises:
        InvalidValueError: ``what`` or the labels are none, or there is no such episode; and as :func:`delete`.
    """
    from aerial_il.core.composition import build

    if what == "undo":
        edit = undo(Undo(dataset=dataset, progress=False))
        return f"{edit.count} episodes are back as they were."
    if what not in ("delete", "relabel"):
        raise InvalidValueError(f"{what!r} is not one of delete, relabel, undo.")
    digest = hashlib.sha256("\n".join(sorted(map(str, uids))).encode()).hexdigest()[:8]
    asked = {"dataset": dataset, "where": f"marked on the page, {digest}", "progress": False}
    if what == "delete":
        return f"{len(_edit(Delete(**asked), None, uids).episodes)} episodes are in the trash."
    settings = build(Relabel, {**(labels or {}), **asked})
    return f"{len(_edit(settings, _labels(settings), uids).episodes)} episodes are relabelled."


def _labels(settings: Relabel) -> Labels:
    from aerial_il.data.curation.relabelling import Labels

    return Labels(**{name: getattr(settings, name) for name in ("success", "operator", "instruction", "tag")})


def _edit(settings: Delete | Relabel, labels: Labels | None, uids: Sequence[str] | None = None) -> Edit:
    """Edit the episodes of ``uids``, or those for which the condition of ``settings`` holds."""
    from aerial_il.data.curation.edits import Edits
    from aerial_il.data.curation.relabelling import check_given
    from aerial_il.data.curation.selection import named, select
    from aerial_il.data.dataset import open_dataset

    with Edits.of(settings.dataset, progress=settings.progress) as edits:
        if (resumed := edits.finish()) is not None:
            log.info("An edit that was interrupted is finished: %d episodes.", len(resumed.episodes))
            if resumed.state == "done" and resumed.asked == (settings.where, labels):
                return resumed
        dataset = open_dataset(settings.dataset, failures=True, states=False)
        rows = named(dataset, uids) if uids is not None else select(dataset, settings.where, progress=settings.progress)
        if labels is not None:
            check_given(rows, labels)
        edit = edits.make([row["uid"] for row in rows], settings.where, labels)
        _log(edits, "delete" if labels is None else "relabel", edit)
        return edit


def _log(edits: Edits, what: str, edit: Edit) -> None:
    """Note an edit beside the runs that recorded the episodes."""
    made = {"edit": what, "number": edit.number, "where": edit.where, "episodes": edit.count}
    given = {"labels": edit.labels.given} if edit.labels else {}
    given |= {edit.marks.column: dict(edit.marks.after)} if edit.marks else {}
    edits.folder.log({**made, **given, "ended": datetime.now(UTC).isoformat(timespec="seconds")})
