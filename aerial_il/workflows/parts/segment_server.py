"""Serves the page on which a person says where flights are cut."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import open_dataset
from aerial_il.generation.cuts import Cut
from aerial_il.generation.moves import cuts_of, find_cuts
from aerial_il.generation.source import Source, source_of
from aerial_il.presentation.pages.segment import segment_page
from aerial_il.workflows.edit import set_cuts, undo_cuts
from aerial_il.workflows.parts.local_server import LocalServer


class SegmentServer(LocalServer):
    """The page of some flights, their films and their cuts.

    Args:
        dataset: path. uids: of the flights. port: as of every server.
    """

    def __init__(self, dataset: str, uids: Sequence[str], port: int) -> None:
        self._dataset, self._uids = open_dataset(dataset), uids
        super().__init__(dataset, port)

    def page(self) -> str:
        return segment_page(self.dataset, self._uids)

    def answer(self, path: str, asked: Mapping[str, Any]) -> Mapping[str, Any] | bytes:
        """Return a film, or keep cuts, or take the last ones back, and return the flight and its cuts as they stand."""
        uid = str(asked["uid"])
        if path == "/film":
            return self.film(uid)
        return self.in_turn(self._edited, path, uid, asked)

    def _edited(self, path: str, uid: str, asked: Mapping[str, Any]) -> dict[str, Any]:
        if path == "/save":
            set_cuts(self.dataset, source_of(self._dataset, uid), _cuts(asked["cuts"]))
        elif path == "/undo":
            undo_cuts(self.dataset)
        elif path != "/flight":
            raise InvalidValueError(f"{path!r} is not one of /film, /flight, /save, /undo.")
        return _told(source_of(self._dataset, uid))


def _cuts(asked: Any) -> list[Cut] | None:
    """Return the cuts that a page asks for; None for those that are found."""
    if asked is None:
        return None
    cuts = [Cut(each["thing"], each["first"], each["last"]) for each in asked]
    if any(type(step) is not int for cut in cuts for step in (cut.first, cut.last)):
        raise InvalidValueError("A cut begins and ends at whole steps.")
    return cuts


def _told(source: Source) -> dict[str, Any]:
    """Return a flight as the page's script reads it."""
    return {
        "steps": len(source),
        "step_s": source.spec.control_dt_s,
        "things": source.names,
        "gripper": source.gripper.tolist(),
        "phases": [{"first": first, "name": name} for first, name in source.phases.items()],
        "cuts": [vars(cut) for cut in cuts_of(source)],
        "found": [vars(cut) for cut in find_cuts(source)],
        "by_hand": source.cuts is not None,
    }
