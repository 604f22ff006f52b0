"""The figure of the page of results: success of clones over the number of demonstrations, from the study's record."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aerial_il.presentation.svg import COLOURS, INK, in_panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CLONES = Path("experiments/learning_curve/results.json")
EXPERTS = Path("experiments/experts/results.json")
DASHES = ("solid", "dashed")  # of tasks
TITLE = "Success of clones in calm air, unseen seeds, three trainings on other demonstrations each"


def drawing(root: Path) -> str:
    """Return an SVG: a line for each robot and task, with Wilson's intervals, and the experts beside them."""
    clones, experts = _table(root / CLONES), _table(root / EXPERTS)
    curves = {key: list(rows) for key, rows in groupby(clones, key=lambda row: (row["robot"], row["task"]))}
    robots, tasks = (list(dict.fromkeys(key[i] for key in curves)) for i in (0, 1))
    sizes = sorted({row["demos"] for row in clones})
    shown = [row for row in experts if row["tier"] == "calm" and (row["robot"], row["task"]) in curves]
    percent, low = (min(row[name] for row in shown) for name in ("percent", "ci95_low"))

    def draw(axes: Axes, _: str) -> None:
        axes.axhline(percent, color=INK, linewidth=1, label=f"the experts: {percent:.0f} (from {low:.0f})")
        for (robot, task), rows in curves.items():
            colour, x = COLOURS[robots.index(robot)], [row["demos"] for row in rows]
            dashes, label = DASHES[tasks.index(task)], f"{task}, {robot}"
            axes.plot(x, [row["percent"] for row in rows], color=colour, linestyle=dashes, label=label)
            axes.vlines(x, *([row[f"flights_{end}"] for row in rows] for end in ("low", "high")), colors=colour)
        axes.set_xscale("log")
        axes.set_xticks(sizes, map(str, sizes))
        axes.set_xticks([], minor=True)
        axes.set(ylim=(0, 105), xlabel="demonstrations", ylabel="success (%)")

    return in_panels({"": TITLE}, draw, width=2.6, height=1.8)


def _table(file: Path) -> Sequence[Mapping[str, Any]]:
    return next(iter(json.loads(file.read_text(encoding="utf-8"))["tables"].values()))
