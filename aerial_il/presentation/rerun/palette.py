"""Colours, the same in the scene and in the plots."""

from collections.abc import Sequence

Colour = tuple[int, int, int]

BACKGROUND: Colour = (244, 246, 249)
GROUND: Colour = (226, 230, 235)
TOOL: Colour = (31, 111, 194)
COMMAND: Colour = (214, 64, 126)
PREDICTED: Colour = (140, 82, 200)
OBJECT: Colour = (226, 110, 20)
GOAL: Colour = (26, 150, 78)
THRUST: Colour = (18, 140, 150)
CONTACT: Colour = (214, 39, 40)
WIND: Colour = (95, 150, 215)
REWARD: Colour = (26, 150, 78)
DONE: Colour = (26, 150, 78)
UNDONE: Colour = (208, 213, 220)
AXES: tuple[Colour, ...] = ((206, 62, 62), (58, 150, 70), (52, 104, 200))
MANY: tuple[Colour, ...] = (
    (31, 111, 194), (226, 110, 20), (26, 150, 78), (140, 82, 200), (150, 98, 70), (214, 64, 126), (18, 140, 150),
    (150, 150, 30), (110, 118, 130), (206, 62, 62),
)  # fmt: skip


def series(count: int) -> list[Colour]:
    """Return a colour for each of ``count`` curves; three are the axes' own."""
    return list(AXES) if count == len(AXES) else [MANY[i % len(MANY)] for i in range(count)]


def paler(colours: Sequence[Colour], share: float = 0.55) -> list[Colour]:
    """Return the colours mixed with white, ``share`` of it."""
    return [tuple(round(c + share * (255 - c)) for c in colour) for colour in colours]  # type: ignore[misc]
