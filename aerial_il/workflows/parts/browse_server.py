"""Serves the page that browses a dataset."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aerial_il.core.errors import AerialError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.table import Row, read_table
from aerial_il.presentation.pages.browse import browse_page, table_of
from aerial_il.workflows.edit import edit_marked
from aerial_il.workflows.parts.local_server import LocalServer


class BrowseServer(LocalServer):
    """The page of one dataset, its films and its edits."""

    def rows(self) -> list[Row]:
        """Return the table as it is now."""
        try:
            return read_table(open_dataset(self.dataset, failures=True, states=False))
        except AerialError:
            if (Path(self.dataset) / "trash").is_dir():  # all of it was deleted
                return []
            raise

    def page(self) -> str:
        return browse_page(self.dataset, self.rows())

    def answer(self, path: str, asked: Mapping[str, Any]) -> Mapping[str, Any] | bytes:
        """Return a film, or make an edit, or take the last one back, and return the table and what was done."""
        if path == "/film":
            return self.film(str(asked["uid"]))
        said = self.in_turn(edit_marked, self.dataset, **asked)
        return {**table_of(self.rows()), "said": said}
