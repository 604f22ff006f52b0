"""Serves the page on which a person says which of two segments is the better one."""

from collections.abc import Mapping, Sequence
from typing import Any

from aerial_il.core.errors import InvalidValueError
from aerial_il.data.preferences.file import PreferenceFile
from aerial_il.data.preferences.pairs import Pair, Preference
from aerial_il.presentation.pages.page import page_text
from aerial_il.workflows.parts.local_server import LocalServer


class PreferServer(LocalServer):
    """The page of some pairs, their films and the answers.

    Args:
        dataset: path. pairs: that are asked about, in their order. file: of the answers. port: as of every server.
    """

    def __init__(self, dataset: str, pairs: Sequence[Pair], file: PreferenceFile, port: int) -> None:
        self._pairs, self._file = pairs, file
        super().__init__(dataset, port)

    def page(self) -> str:
        return page_text("prefer.html.j2", dataset=self.dataset, data=self._state())

    def answer(self, path: str, asked: Mapping[str, Any]) -> Mapping[str, Any] | bytes:
        """Return the film of one side of a pair, or keep what was said of one and return which is next."""
        pair = self._pair(asked["pair"])
        if path == "/film":
            segment = pair[("left", "right").index(asked["side"])]
            return self.film(segment.uid, range(segment.first, segment.first + segment.length))
        self.in_turn(self._keep, Preference(*pair, asked["preferred"], "hand"))
        return self._state()

    def _pair(self, number: object) -> Pair:
        if type(number) is not int or not 0 <= number < len(self._pairs):
            raise InvalidValueError(f"pair is {number!r}; it must lie in [0, {len(self._pairs) - 1}].")
        return self._pairs[number]

    def _keep(self, preference: Preference) -> None:
        """Add what was said, once: a page that is open twice may ask again."""
        if preference.pair not in self._said():
            self._file.add(preference)

    def _said(self) -> set[Pair]:
        return {preference.pair for preference in self._file.preferences}

    def _state(self) -> dict[str, Any]:
        """Return which pairs have no answer yet, and how many there are."""
        said = self._said()
        left = [number for number, pair in enumerate(self._pairs) if pair not in said]
        return {"left": left[:2], "said": len(self._pairs) - len(left), "pairs": len(self._pairs)}
