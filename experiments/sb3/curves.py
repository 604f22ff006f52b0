"""The returns of both sides on the way: what a study keeps of them, and the figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from aerial_il.presentation.svg import COLOURS, in_panels
from experiments.sb3.theirs import Found

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POINTS = 100  # that are kept of a curve


def kept(found: Found) -> dict[str, Any]:
    """Return a side's training for a study's file: not every point of its curve, nor every digit."""
    every = -(-len(found.curve) // POINTS)
    points = found.curve[::-1][:: max(every, 1)][::-1]  # the last one always
    curve = [(steps, round(seconds, 2), round(mean, 3)) for steps, seconds, mean in points]
    return {**asdict(found), "returns": [round(value, 3) for value in found.returns], "curve": curve}


def return_curves(found: Mapping[str, Sequence[Sequence[Found]]], sides: Sequence[str]) -> str:
    """Draw the mean return of the last hundred episodes over time: a panel per comparison, a line per training.

    Args:
        found: comparison -> trainings, one of each of the ``sides``.
    """

    def draw(axes: Axes, name: str) -> None:
        for k, pair in enumerate(found[name]):
            for side, colour, label in zip(pair, COLOURS, sides, strict=False):
                minutes = [seconds / 60.0 for _, seconds, _ in side.curve]
                returns = [mean for *_, mean in side.curve]
                axes.plot(minutes, returns, color=colour, linewidth=1.0, label=None if k else label)
        axes.set_xlim(left=0.0)
        axes.set_xlabel("minutes")
        axes.set_ylabel("return, exploring")

    return in_panels({name: name.replace("_", " ") for name in found}, draw)
