"""Notes of a page: sentences that speak of what is on it, and what flew and was shown."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class About:
    """A sentence about some arms, or comparisons, for pages with any of them.

    Attributes:
        names: of them. said: the sentence; ``{}`` stands for those that are on the page, ``{name}`` for a value.
    """

    names: tuple[str, ...]
    said: str


Note = Sequence[str | About]


def notes_on(page: Collection[str], notes: Iterable[Note], **values: object) -> Iterator[str]:
    """Yield the notes of a page with these names on it; a note of which no sentence is left, not at all."""
    for note in notes:
        if said := " ".join(filter(None, (_said(part, page, values) for part in note))):
            yield said


def demonstrator(robot: str, noise: float) -> str:
    """Return in words what flies, and who demonstrates on it."""
    how = f"with a noise of {noise:g} (1: all that it can recover from)" if noise else "without noise"
    return f"{robot}, demonstrated by its scripted expert {how}"


def listed(names: Sequence[str]) -> str:
    """Return names as a sentence has them: ``a``, ``a and b``, ``a, b and c``."""
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def _said(part: str | About, page: Collection[str], values: Mapping[str, object]) -> str:
    if isinstance(part, str):
        return part
    found = [name for name in part.names if name in page]
    return part.said.format(listed(found), **values) if found else ""
