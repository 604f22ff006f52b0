"""Serves the page on which a person says where flights are cut."""

from collections.abc import Mapping, Sequence
from typing import Any

from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import open_dataset
from aerial_il.generation.moves import cuts_of
from aerial_il.generation.source import Source, source_of
from aerial_il.presentation.pages.page import page_text
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
        return page_text("segment.html.j2", dataset=self.dataset, data=list(self._uids))

    def answer(self, path: str, asked: Mapping[str, Any]) -> Mapping[str, Any] | bytes:
        """Return a film; or keep cuts as they are typed, or take the last ones back, and return how a flight is cut."""
        uid = str(asked["uid"])
        return self.film(uid) if path == "/film" else self.in_turn(self._edited, path, uid, asked)

    def _edited(self, path: str, uid: str, asked: Mapping[str, Any]) -> dict[str, Any]:
        if path == "/save":
            set_cuts(self.dataset, source_of(self._dataset, uid), [str(word) for word in asked["cuts"]])
        elif path == "/undo":
            undo_cuts(self.dataset)
        elif path != "/flight":
            raise InvalidValueError(f"{path!r} is not one of /film, /flight, /save, /undo.")
        return _told(source_of(self._dataset, uid))


def _told(source: Source) -> dict[str, Any]:
    """Return a flight as the page's script reads it."""
    return {
        "uid": source.uid,
        "steps": len(source),
        "step_s": source.spec.control_dt_s,
        "things": source.names,
        "gripper": source.gripper.tolist(),
        "phases": [{"first": first, "name": name} for first, name in source.phases.items()],
        "cuts": [vars(cut) for cut in cuts_of(source)],
        "by_hand": source.cuts is not None,
    }
