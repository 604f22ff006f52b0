"""The drawing of the layers and their order, from the contract that ``make check`` enforces."""

import ast
import textwrap
import tomllib
from html import escape
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]
CONTRACT = "pyproject.toml"
ABOVE = {"experiments": "studies of a checkout, run by aerial-il bench NAME: they import all, and nothing imports them"}
WIDTH, HEIGHT, GAP, MARGIN = 960, 62, 12, 16  # px; of a row, between rows
INK, FILL, EDGE, QUIET = "#18202a", "#e8f0fb", "#7fa6d6", "#4a5866"


def layers(root: Path) -> list[list[str]]:
    """Return the packages from the top layer to the lowest, as ``pyproject.toml`` orders them."""
    settings = tomllib.loads((root / CONTRACT).read_text(encoding="utf-8"))
    contract = settings["tool"]["importlinter"]["contracts"][0]
    return [[package.strip() for package in layer.split("|")] for layer in contract["layers"]]


def drawing(root: Path) -> str:
    """Return an SVG: a row for each layer, each package with what it is for; a row stands on those below it."""
    rows = [[*ABOVE], *layers(root)]
    height = 2 * MARGIN + len(rows) * (HEIGHT + GAP) - GAP
    shapes = [_row(packages, MARGIN + i * (HEIGHT + GAP)) for i, packages in enumerate(rows)]
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}" '
        'font-family="sans-serif" role="img" aria-label="Packages in layers">'
    )
    background = f'<rect width="{WIDTH}" height="{height}" rx="8" fill="#ffffff"/>'
    return "\n".join([head, background, *shapes, "</svg>", ""])


def _row(packages: list[str], top: int) -> str:
    width = (WIDTH - 2 * MARGIN - GAP * (len(packages) - 1)) / len(packages)
    return "\n".join(_box(package, MARGIN + i * (width + GAP), top, width) for i, package in enumerate(packages))


def _box(package: str, left: float, top: int, width: float) -> str:
    middle, most = left + width / 2, int((width - 14) / 6.4)
    lines = textwrap.wrap(_purpose(package), most, max_lines=2, placeholder=" …")
    texts = [f'<text x="{middle:.0f}" y="{top + 20}" fill="{INK}" font-size="15" font-weight="600">{package}</text>']
    texts += [
        f'<text x="{middle:.0f}" y="{top + 37 + 15 * i}" fill="{QUIET}" font-size="12">{escape(line)}</text>'
        for i, line in enumerate(lines)
    ]
    edge = f'stroke="{EDGE}"' + (' stroke-dasharray="5 4"' if package in ABOVE else "")
    box = f'<rect x="{left:.0f}" y="{top}" width="{width:.0f}" height="{HEIGHT}" rx="6" fill="{FILL}" {edge}/>'
    return "\n".join([box, '<g text-anchor="middle">', *texts, "</g>"])


def _purpose(package: str) -> str:
    """Return the first line of a package's docstring, without the name before its colon."""
    if package in ABOVE:
        return ABOVE[package]
    text = ast.get_docstring(ast.parse((PACKAGE / package / "__init__.py").read_text(encoding="utf-8"))) or ""
    line = text.partition("\n")[0].replace("``", "").rstrip(".")
    name, colon, rest = line.partition(": ")
    return rest if colon else name
