"""The figure of practice from a prior: success on the way, and beside it that of the final policies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from aerial_il.presentation.svg import INK, in_panels
from experiments.common.figures import Rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Cell = tuple[str, int]  # a task, and the demonstrations to begin with
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#882255", "#332288", "#999933")
MARKERS, DASHES = "osD^vPX<>", ("solid", (0, (5, 1.5)), (0, (1, 1)))
UNPRACTISED = (("#888888", "p"), ("#555555", "h"), ("#111111", "*"))  # colour and marker of those that fly nothing
STEP_TICKS = {0.0: "0", 1e5: "100k", 5e5: "500k", 1e6: "1M", 2e6: "2M", 4e6: "4M", 8e6: "8M", 2e7: "20M"}
MINUTE_TICKS = {float(m): str(m) for m in (0, 1, 5, 10, 20, 40, 60, 120, 240, 480)}
STRIP = (1.03, 0.0, 0.3, 1.0)  # where the final policies stand, in shares of a panel
LEAST_APART = 0.1  # ticks, in shares of the axis
ROOM = 3.0  # points of success below the lowest and above 100


@dataclass(frozen=True)
class Look:
    """How an arm is drawn."""

    colour: str
    marker: str
    dashes: str | tuple[float, tuple[float, ...]]


def practice_lines(
    rows: Rows, final: Rows, *, over: str, titles: Mapping[Cell, str], wanted: Mapping[Cell, float]
) -> str:
    """Draw success while practising: a panel per cell, a line per training, and the final policies at its right.

    Args:
        rows: success on the way with ``arm``, ``task``, ``demos``, ``draw``, ``percent``, ``over`` and ``faint``, in
            order. final: success of the final policies with ``arm``, ``task``, ``demos``, ``flown``, and ``percent``
            with ``flights_low`` and ``flights_high``.
        over: what is drawn over, ``flown`` steps or ``minutes``. titles: of the panels. wanted: cell -> percent.
    """
    looks = looks_of(final)

    def draw(axes: Axes, cell: Cell) -> None:
        lines, dots = ([row for row in given if _cell(row) == cell] for given in (rows, final))
        for arm, look in looks.items():
            _draw_trainings(axes, [row for row in lines if row["arm"] == arm], look, over)
            axes.plot([], [], color=look.colour, marker=look.marker, linestyle=look.dashes, markersize=5, label=arm)
        strip = _draw_final(axes, dots, looks)
        for part in (axes, strip) if cell in wanted else ():
            part.axhline(wanted[cell], color=INK, linestyle="dashed", linewidth=0.9, zorder=1)
        if wanted:
            axes.plot([], [], color=INK, linestyle="dashed", linewidth=0.9, label="wanted")
        lowest = min([*(row["percent"] for row in lines), *(row["flights_low"] for row in dots)])
        axes.set_ylim(max(0.0, lowest) - ROOM, 100.0 + ROOM)
        axes.set_ylabel("success (%)")
        _scale(axes, over)

    return in_panels(titles, draw, width=1.6, height=1.5)


def looks_of(final: Rows) -> dict[str, Look]:
    """Return how each arm is drawn: in colours those that practise, in grey the others."""
    arms = dict.fromkeys(row["arm"] for row in final)
    practised = {row["arm"] for row in final if row["flown"]}
    grey, coloured = cycle(UNPRACTISED), zip(cycle(COLOURS), cycle(MARKERS), cycle(DASHES))
    return {arm: Look(*next(coloured)) if arm in practised else Look(*next(grey), "none") for arm in arms}


def _draw_trainings(axes: Axes, rows: Rows, look: Look, over: str) -> None:
    """Draw a line per training; faint and without markers where its own practice is all that is known."""
    for training in dict.fromkeys(row["draw"] for row in rows):
        drawn = [row for row in rows if row["draw"] == training and row[over] is not None]
        faint = bool(drawn) and drawn[0]["faint"]
        axes.plot(
            [row[over] for row in drawn],
            [row["percent"] for row in drawn],
            color=look.colour,
            linestyle="solid" if faint else look.dashes,
            linewidth=0.7 if faint else 1.0,
            alpha=0.6 if faint else None,
            marker="none" if faint else look.marker,
            markersize=3.5,
            markeredgewidth=0,
        )


def _draw_final(axes: Axes, rows: Rows, looks: Mapping[str, Look]) -> Axes:
    """Draw the final policies with their intervals beside a panel, one after the other; return where."""
    strip = axes.inset_axes(STRIP, sharey=axes)
    for place, row in enumerate(rows):
        look, ends = looks[row["arm"]], np.array([[row["flights_low"]], [row["flights_high"]]])
        away = np.abs(ends - row["percent"])
        strip.errorbar(place, row["percent"], yerr=away, color=look.colour, marker=look.marker, markersize=5, capsize=2)
    strip.set_xlim(-0.7, len(rows) - 0.3)
    strip.set_xticks([])
    strip.set_xlabel("final")
    strip.tick_params(axis="y", left=False, labelleft=False)
    strip.spines["left"].set_visible(False)
    return strip


def _scale(axes: Axes, over: str) -> None:
    """Give the beginning, where most happens, more room: a square-root axis."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    ticks = STEP_TICKS if over == "flown" else MINUTE_TICKS
    axes.set_xscale("function", functions=(lambda x: np.sqrt(np.maximum(x, 0.0)), np.square))
    axes.xaxis.set_major_locator(FixedLocator(kept_apart(list(ticks), axes.get_xlim()[1])))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: ticks[x]))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlim(left=0.0)
    axes.set_xlabel("control steps flown" if over == "flown" else "minutes of flying and learning")


def kept_apart(ticks: Sequence[float], last: float) -> list[float]:
    """Return those of the ticks, in order, whose labels do not touch where the axis ends with ``last``."""
    kept = [ticks[0]]
    for tick in ticks[1:]:
        if np.sqrt(tick / last) - np.sqrt(kept[-1] / last) >= LEAST_APART:
            kept.append(tick)
    return kept


def _cell(row: Mapping[str, object]) -> Cell:
    return row["task"], row["demos"]  # type: ignore[return-value]
