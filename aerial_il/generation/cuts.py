"""Where a flight is cut: which of its steps are about which thing, as it was found or as a person says it."""

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from aerial_il.core.errors import DemoError, InvalidValueError, UnknownNameError
from aerial_il.data.table import FURTHER, read_columns

COLUMN = "cuts"  # of a dataset's table: uid -> cuts by hand, as they are typed
_TYPED = re.compile(r"(.+):(\d+)-(\d+)", re.ASCII)


@dataclass(frozen=True)
class Cut:
    """Steps of a flight that are about a thing: from ``first`` on, before ``last``. Typed: ``cube:40-95``."""

    thing: str
    first: int
    last: int

    def __str__(self) -> str:
        return f"{self.thing}:{self.first}-{self.last}"


def read_cut(word: str) -> Cut:
    """Return a cut as it is typed.

    Raises:
        InvalidValueError: it is none.
    """
    if (found := _TYPED.fullmatch(word.strip())) is None:
        raise InvalidValueError(f"{word!r} is no cut. Type THING:FIRST-LAST in steps, such as cube:40-95.")
    return Cut(found[1], int(found[2]), int(found[3]))


def text_of(cuts: Iterable[Cut]) -> str:
    """Return cuts as they are kept and typed: ``cube:40-95, bowl:120-180``."""
    return ", ".join(map(str, cuts))


def check_cuts(cuts: Sequence[Cut], things: Collection[str], steps: int) -> None:
    """Refuse cuts that a flight of so many ``steps`` in a scene of ``things`` cannot have.

    Raises:
        InvalidValueError: there is none, one is empty or outside of the flight, or they overlap or are out of order.
        UnknownNameError: there is no such thing.
    """
    if not cuts:
        raise InvalidValueError("A flight without a cut shows nothing: add one, or take those that are found.")
    for cut in cuts:
        if cut.thing not in things:
            raise UnknownNameError("thing", cut.thing, things)
        if not 0 <= cut.first < cut.last <= steps:
            raise InvalidValueError(f"{cut} is outside of the flight: 0 <= FIRST < LAST <= {steps}, its steps.")
    for before, after in pairwise(cuts):
        if after.first < before.last:
            raise InvalidValueError(f"{after} begins before {before} ends: cuts follow each other and do not overlap.")


def at_phases(cuts: Iterable[Cut], phases: Collection[int]) -> tuple[Cut, ...]:
    """Return cuts with each edge moved to the nearest of the steps at which phases begin or end.

    Raises:
        InvalidValueError: the flight was recorded without phases.
    """
    if not phases:
        raise InvalidValueError("The flight was recorded without phases: type the cuts, as THING:FIRST-LAST.")

    def nearest(step: int) -> int:
        return min(phases, key=lambda border: abs(border - step))

    return tuple(Cut(cut.thing, nearest(cut.first), nearest(cut.last)) for cut in cuts)


def cuts_by_hand(folder: Path) -> dict[str, tuple[Cut, ...]]:
    """Return uid -> cuts of the episodes of a dataset's ``folder`` that a person has cut.

    Raises:
        DemoError: what lies there are no cuts.
    """
    said = read_columns(folder).get(COLUMN, {})
    try:
        return {uid: tuple(map(read_cut, text.split(","))) for uid, text in said.items() if text is not None}
    except (InvalidValueError, AttributeError) as error:
        raise DemoError(folder / FURTHER / f"{COLUMN}.json", f"cannot be used ({error}).") from error
