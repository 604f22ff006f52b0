"""Figures as SVG: the same numbers give the same bytes, so that a figure changes only with what it shows."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, COLOURS = "#333333", ("#3b6fb6", "#d98032", "#4f9d69", "#a65a9b", "#8c8c8c", "#c0504d")
LEGEND_COLUMNS = 6
LEGEND_COLUMN_IN = 2.0  # width of one, with a long name
PANEL_IN = (3.2, 2.3)  # width and height of one panel, inches
TEXT_STYLE: dict[Any, Any] = {
    "svg.hashsalt": "aerial_il", "svg.fonttype": "none", "font.family": "sans-serif", "font.size": 9,
}  # fmt: skip
STYLE: dict[Any, Any] = TEXT_STYLE | {
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e3e3",
    "legend.frameon": False,
    "legend.fontsize": 8,
}


def reward_lines(rewards: Mapping[str, Mapping[str, np.ndarray]]) -> str:
    """Draw a learned reward along episodes, a panel per task, a line per episode.

    Args:
        rewards: task -> name of the episode -> (T,).
    """

    def draw(axes: Axes, task: str) -> None:
        for k, (label, values) in enumerate(rewards[task].items()):
            axes.plot(values, color=COLOURS[k], linewidth=1, label=label)
        axes.set_xlabel("step")
        axes.set_ylabel("learned reward")

    return in_panels({task: task for task in rewards}, draw)


def in_panels[K](
    titles: Mapping[K, str], draw: Callable[[Axes, K], None], *, width: float = 1.0, height: float = 1.0
) -> str:
    """Draw one panel per key, two in a row, and return the SVG.

    Args:
        titles: key -> title. draw: ``(axes, key) -> None``. width, height: of a panel, relative to ``PANEL_IN``.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    columns = min(2, len(titles))
    rows = -(-len(titles) // columns)
    with rc_context(STYLE):
        figure = Figure((width * columns * PANEL_IN[0], height * rows * PANEL_IN[1]), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for panel, (key, title) in zip(axes, titles.items(), strict=False):
            draw(panel, key)
            panel.set_title(title)
        for spare in axes[len(titles) :]:
            spare.set_visible(False)
        _legend(figure, axes[0])
        return svg_text(figure)


def _legend(figure: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        fitting = max(1, int(figure.get_figwidth() / LEGEND_COLUMN_IN))
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(handles), LEGEND_COLUMNS, fitting))


def svg_text(figure: Figure) -> str:
    """Return a figure as the text of an SVG file, without the time at which it was drawn."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Title": "aerial_il"})
    return "\n".join(line.rstrip() for line in buffer.getvalue().splitlines()) + "\n"
