"""Show what there is: robots, tasks, cells, tiers, sensors, action levels, controllers, policies, algorithms.

A cell is a robot with a task that it can do; where it cannot, declined=true says why. Tiers are shown with the
components that they may be made of. The gallery shows all cells, with a film of an expert's flight each.

Example: aerial-il list declined=true
Example: aerial-il list json=true
Example: aerial-il list html=true
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from aerial_il.cli.as_json import AsJson
from aerial_il.cli.tables import table, wrapped
from aerial_il.workflows.catalogue import Catalogue, Gallery, catalogue, gallery

HIDDEN = ("summary",)  # too long for a terminal's table


@dataclass(frozen=True, kw_only=True)
class Shown(AsJson, Gallery):
    """How it is shown.

    Attributes:
        declined: also the cells that are declined, with the reason.
    """

    declined: bool = False


SETTINGS = Shown


def run(settings: Shown) -> None:
    """Print the catalogue, or write the gallery and say where it is."""
    if settings.page is None:
        contents = catalogue()
        settings.show(contents, lambda: as_text(contents, declined=settings.declined))
        return
    written = gallery(settings, settings.page)
    if written.note:
        print(written.note)
    print(f"Gallery: {written.page} ({written.page.stat().st_size / 1e6:.1f} MB)")
    if written.sheet is not None:
        print(f"Sheet: {written.sheet}")


def as_text(contents: Catalogue, *, declined: bool = False) -> str:
    """Lay the catalogue out in tables."""
    left_out = {"cells"} if declined else {"cells", "declined"}
    rows = {
        title: [{key: value for key, value in entry.items() if key not in HIDDEN} for entry in entries]
        for title, entries in contents.items()
        if title not in left_out
    }
    return "\n\n".join(f"{title.replace('_', ' ').capitalize()}\n{_laid_out(each)}" for title, each in rows.items())


def _laid_out(entries: Sequence[Mapping[str, Any]]) -> str:
    """Return a table; of what has nothing but names, these in a line."""
    if all(entry.keys() == {"name"} for entry in entries):
        return wrapped("  " + ", ".join(entry["name"] for entry in entries))
    return table(entries)
