"""The drawing of the rooms and their order, from the contract that ``make check`` enforces."""

from __future__ import annotations

import ast
import textwrap
import tomllib
from html import escape
from pathlib import Path

from aerial_il.presentation.documentation.modules import PACKAGE

CONTRACT = "pyproject.toml"
WIDTH, HEIGHT, GAP, MARGIN = 960, 62, 12, 16  # px; of a row, between rows
INK, FILL, EDGE, QUIET = "#18202a", "#e8f0fb", "#7fa6d6", "#4a5866"


def layers(root: Path) -> list[list[str]]:
    """Return the rooms from the top layer to the lowest, as ``pyproject.toml`` orders them."""
    settings = tomllib.loads((root / CONTRACT).read_text(encoding="utf-8"))
    contract = settings["tool"]["importlinter"]["contracts"][0]
    return [[room.strip() for room in layer.split("|")] for layer in contract["layers"]]


def drawing(root: Path) -> str:
    """Return an SVG: a row for each layer, each room with what it is for; a row stands on those below it."""
    rows = layers(root)
    height = 2 * MARGIN + len(rows) * (HEIGHT + GAP) - GAP
    shapes = [_row(rooms, MARGIN + i * (HEIGHT + GAP)) for i, rooms in enumerate(rows)]
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}" '
        'font-family="sans-serif" role="img" aria-label="Rooms in layers">'
    )
    background = f'<rect width="{WIDTH}" height="{height}" rx="8" fill="#ffffff"/>'
    return "\n".join([head, background, *shapes, "</svg>", ""])


def _row(rooms: list[str], top: int) -> str:
    width = (WIDTH - 2 * MARGIN - GAP * (len(rooms) - 1)) / len(rooms)
    return "\n".join(_room(room, MARGIN + i * (width + GAP), top, width) for i, room in enumerate(rooms))


def _room(room: str, left: float, top: int, width: float) -> str:
    middle, most = left + width / 2, int((width - 14) / 6.4)
    lines = _wrapped(_purpose(room), most)
    texts = [f'<text x="{middle:.0f}" y="{top + 20}" fill="{INK}" font-size="15" font-weight="600">{room}</text>']
    texts += [
        f'<text x="{middle:.0f}" y="{top + 37 + 15 * i}" fill="{QUIET}" font-size="12">{escape(line)}</text>'
        for i, line in enumerate(lines)
    ]
    box = f'<rect x="{left:.0f}" y="{top}" width="{width:.0f}" height="{HEIGHT}" rx="6" fill="{FILL}" stroke="{EDGE}"/>'
    return "\n".join([box, '<g text-anchor="middle">', *texts, "</g>"])


def _purpose(room: str) -> str:
    """Return the first line of a room's docstring, without the name before its colon."""
    text = ast.get_docstring(ast.parse((PACKAGE / room / "__init__.py").read_text(encoding="utf-8"))) or ""
    line = text.partition("\n")[0].replace("``", "").rstrip(".")
    name, colon, rest = line.partition(": ")
    return rest if colon else name


def _wrapped(text: str, most: int) -> list[str]:
    """Break a text into at most two lines of ``most`` characters; what is left over becomes an ellipsis."""
    return textwrap.wrap(text, most, max_lines=2, placeholder=" …")
