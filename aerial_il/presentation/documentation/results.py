"""The figure of the page of results: success of clones over the number of demonstrations, from the study's record."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

CLONES = Path("experiments/learning_curve/results.json")
EXPERTS = Path("experiments/experts/results.json")
LEFT, RIGHT, TOP, BOTTOM, WIDTH, HEIGHT = 56, 220, 44, 52, 820, 400  # px; margins, and all of it
COLOURS = ("#1f5fa8", "#c2571a")  # of robots
DASHES = ("", "6 4")  # of tasks
INK, QUIET, GRID = "#18202a", "#4a5866", "#dde4ec"
TITLE = "Success of clones in calm air, %, unseen seeds, three trainings on other demonstrations each"

Row = Mapping[str, Any]


def drawing(root: Path) -> str:
    """Return an SVG: a line for each robot and task, with Wilson's intervals, and the experts beside them."""
    clones, experts = _table(root / CLONES), _table(root / EXPERTS)
    curves = {key: list(rows) for key, rows in groupby(clones, key=lambda row: (row["robot"], row["task"]))}
    robots, tasks = (list(dict.fromkeys(key[i] for key in curves)) for i in (0, 1))
    sizes = sorted({row["demos"] for row in clones})
    shown = [row for row in experts if row["tier"] == "calm" and (row["robot"], row["task"]) in curves]
    shapes = [*_axes(sizes), _expert(min(row["percent"] for row in shown), min(row["ci95_low"] for row in shown))]
    for i, ((robot, task), rows) in enumerate(curves.items()):
        style = f'stroke="{COLOURS[robots.index(robot)]}" stroke-dasharray="{DASHES[tasks.index(task)]}"'
        shapes += [_curve(rows, sizes, style), _legend(i, style, f"{task}, {robot}")]
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
        f'font-family="sans-serif" font-size="13" role="img" aria-label="{TITLE}">'
    )
    background = f'<rect width="{WIDTH}" height="{HEIGHT}" rx="8" fill="#ffffff"/>'
    return "\n".join([head, background, _text(LEFT, 24, TITLE, INK), *shapes, "</svg>", ""])


def _table(file: Path) -> list[Row]:
    return next(iter(json.loads(file.read_text(encoding="utf-8"))["tables"].values()))


def _axes(sizes: Sequence[int]) -> list[str]:
    across = [
        f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{_y(v):.1f}" y2="{_y(v):.1f}" stroke="{GRID}"/>'
        + _text(LEFT - 8, _y(v) + 4, f"{v}", QUIET, "end")
        for v in range(0, 101, 20)
    ]
    along = [_text(_x(n, sizes), HEIGHT - BOTTOM + 20, f"{n}", QUIET, "middle") for n in sizes]
    named = _text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 12, "demonstrations", QUIET, "middle")
    return [*across, *along, named]


def _expert(percent: float, low: float) -> str:
    words = f"the experts: {percent:.0f} (from {low:.0f})"
    line = f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{_y(percent):.1f}" y2="{_y(percent):.1f}" stroke="{QUIET}"/>'
    return line + _text(WIDTH - RIGHT + 16, _y(percent) + 4, words, QUIET)


def _curve(rows: Sequence[Row], sizes: Sequence[int], style: str) -> str:
    places = [(_x(row["demos"], sizes), row) for row in rows]
    points = " ".join(f"{x:.1f},{_y(row['percent']):.1f}" for x, row in places)
    bars = " ".join(f"M{x:.1f} {_y(row['flights_low']):.1f}V{_y(row['flights_high']):.1f}" for x, row in places)
    solid = style.partition(" stroke-dasharray")[0]
    return (
        f'<polyline points="{points}" fill="none" stroke-width="2" {style}/>\n'
        f'<path d="{bars}" fill="none" stroke-width="3" {solid}/>'
    )


def _legend(i: int, style: str, words: str) -> str:
    x, y = WIDTH - RIGHT + 16, TOP + 60 + 24 * i
    line = f'<line x1="{x}" x2="{x + 30}" y1="{y}" y2="{y}" stroke-width="2" {style}/>'
    return line + _text(x + 38, y + 4, words, INK)


def _x(size: int, sizes: Sequence[int]) -> float:
    share = math.log(size / sizes[0]) / math.log(sizes[-1] / sizes[0])
    return LEFT + 16 + share * (WIDTH - LEFT - RIGHT - 32)


def _y(percent: float) -> float:
    return TOP + (100 - percent) / 100 * (HEIGHT - TOP - BOTTOM)


def _text(x: float, y: float, words: str, colour: str, anchor: str = "start") -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}" fill="{colour}" text-anchor="{anchor}">{words}</text>'
