"""Figures of studies as SVG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from aerial_il.presentation.svg import COLOURS, INK, PANEL_IN, in_panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Rows = Sequence[Mapping[str, Any]]
ROW_IN = 0.2  # of a line that names a bar


def tracking_bars(rows: Rows, limits_cm: Mapping[tuple[str, str], Mapping[str, float]]) -> str:
    """Draw the tool's RMSE: a panel per robot and reference, tiers side by side, a bar per flight law, targets dashed.

    Args:
        rows: of the first table of the tracking benchmark. limits_cm: (robot, tier) -> reference -> largest RMSE, cm.
    """
    panels = list(dict.fromkeys((r["robot"], r["reference"]) for r in rows))
    tiers, laws = (list(dict.fromkeys(r[k] for r in rows)) for k in ("tier", "controller"))
    width = 0.8 / len(laws)

    def draw(axes: Axes, panel: tuple[str, str]) -> None:
        for k, law in enumerate(laws):
            bars = [r for r in rows if (r["robot"], r["reference"]) == panel and r["controller"] == law]
            places = [tiers.index(r["tier"]) + width * (k - 0.5 * (len(laws) - 1)) for r in bars]
            values, spread = [r["rmse_cm"] for r in bars], [r["seed_sd_cm"] for r in bars]
            axes.bar(places, values, 0.94 * width, yerr=spread, color=COLOURS[k], ecolor=INK, label=law)
        for i, tier in enumerate(tiers):
            limit = limits_cm.get((panel[0], tier), {}).get(panel[1])
            if limit is not None:
                axes.hlines(limit, i - 0.4, i + 0.4, colors=INK, linestyles="dashed")
        axes.set_xticks(range(len(tiers)), tiers)
        axes.set_ylabel("tool RMSE (cm)")
        axes.grid(axis="x", visible=False)

    return in_panels({panel: f"{panel[0]}, {panel[1]}" for panel in panels}, draw)


def success_dots(rows: Rows, limits: Mapping[str, float]) -> str:
    """Draw success with 95 % intervals: a panel per tier, a line per task, a colour per robot, targets dashed.

    Args:
        rows: with ``robot``, ``task``, ``tier``, ``percent``, ``ci95_low`` and ``ci95_high``. limits: tier -> percent.
    """
    robots, tasks = (sorted({r[key] for r in rows}) for key in ("robot", "task"))
    lowest, step = min(*(r["ci95_low"] for r in rows), *limits.values()), 0.8 / len(robots)

    def draw(axes: Axes, tier: str) -> None:
        for k, robot in enumerate(robots):
            shown = [r for r in rows if (r["tier"], r["robot"]) == (tier, robot)]
            y = [tasks.index(r["task"]) + step * (k - 0.5 * (len(robots) - 1)) for r in shown]
            ends = ([r[end] for r in shown] for end in ("ci95_low", "ci95_high"))
            colour, mark = COLOURS[k % len(COLOURS)], "os"[k // len(COLOURS)]
            axes.hlines(y, *ends, colors=colour, linewidth=1)
            axes.plot([r["percent"] for r in shown], y, mark, color=colour, markersize=3, label=robot)
        if tier in limits:
            axes.axvline(limits[tier], color=INK, linestyle="dashed", linewidth=1)
        axes.set_yticks(range(len(tasks)), [task.replace("_", " ") for task in tasks])
        axes.set_ylim(len(tasks) - 0.5, -0.5)
        axes.set_xlim(lowest - 1.0, 100.5)
        axes.set_xlabel("success (%)")
        axes.grid(axis="y", visible=False)

    titles = {tier: tier for tier in dict.fromkeys(r["tier"] for r in rows)}
    return in_panels(titles, draw, width=1.2, height=max(1.0, len(tasks) / 7))


def method_dots(rows: Rows) -> str:
    """Draw success with 95 % intervals: a panel per pair of tiers, a line per task, a colour per policy class.

    Args:
        rows: with ``method``, ``task``, ``trained_in``, ``flown_in``, ``percent``, ``ci95_low`` and ``ci95_high``.
    """
    methods, tasks = (list(dict.fromkeys(r[key] for r in rows)) for key in ("method", "task"))
    step = 0.7 / len(methods)

    def draw(axes: Axes, tiers: tuple[str, str]) -> None:
        for k, method in enumerate(methods):
            shown = [r for r in rows if (r["trained_in"], r["flown_in"], r["method"]) == (*tiers, method)]
            y = [tasks.index(r["task"]) + step * (k - 0.5 * (len(methods) - 1)) for r in shown]
            x = [r["percent"] for r in shown]
            errors = [[r["percent"] - r["ci95_low"] for r in shown], [r["ci95_high"] - r["percent"] for r in shown]]
            colour = COLOURS[k % len(COLOURS)]
            axes.errorbar(x, y, xerr=errors, fmt="o", color=colour, markersize=4, linewidth=1, label=method)
        axes.set_yticks(range(len(tasks)), [task.replace("_", " ") for task in tasks])
        axes.set_ylim(len(tasks) - 0.5, -0.5)
        axes.set_xlim(-3, 103)
        axes.set_xlabel("success (%)")
        axes.grid(axis="y", visible=False)

    pairs = dict.fromkeys((r["trained_in"], r["flown_in"]) for r in rows)
    titles = {pair: f"learned in {pair[0]}, flown in {pair[1]}" for pair in pairs}
    return in_panels(titles, draw, width=1.2, height=max(1.0, len(tasks) / 7))


def learning_lines(rows: Rows, limits: Mapping[str, float]) -> str:
    """Draw success over the number of demonstrations: a panel per task, a line with intervals per robot.

    Args:
        rows: with ``robot``, ``task``, ``demos``, ``percent``, ``ci95_low`` and ``ci95_high``. limits: task -> percent.
    """
    robots = list(dict.fromkeys(r["robot"] for r in rows))

    def draw(axes: Axes, task: str) -> None:
        for k, robot in enumerate(robots):
            found = [r for r in rows if (r["robot"], r["task"]) == (robot, task)]
            points = sorted(found, key=lambda r: r["demos"])
            x, y = [r["demos"] for r in points], [r["percent"] for r in points]
            errors = [[r["percent"] - r["ci95_low"] for r in points], [r["ci95_high"] - r["percent"] for r in points]]
            axes.errorbar(
                x, y, yerr=errors, color=COLOURS[k % len(COLOURS)], marker="o", markersize=4, capsize=2, label=robot
            )
        if task in limits:
            axes.axhline(limits[task], color=INK, linestyle="dashed", linewidth=1)
        sizes = sorted({r["demos"] for r in rows if r["task"] == task})
        axes.set_xscale("log")
        axes.set_xticks(sizes, [str(size) for size in sizes])
        axes.minorticks_off()
        axes.set_ylim(-3, 103)
        axes.set_xlabel("demonstrations")
        axes.grid(axis="x", visible=False)
        axes.set_ylabel("success (%)")

    return in_panels({task: task for task in dict.fromkeys(r["task"] for r in rows)}, draw)


def success_curves(curves: Mapping[tuple[str, str], Sequence[Sequence[tuple[float, float]]]]) -> str:
    """Draw success over environment steps: a panel each, a line per arm, from its lowest training to its highest.

    Args:
        curves: (panel, arm) -> trainings, each (steps, percent) at the same steps.
    """
    from matplotlib.ticker import EngFormatter

    arms = list(dict.fromkeys(arm for _, arm in curves))

    def draw(axes: Axes, panel: str) -> None:
        for k, arm in enumerate(arms):
            if (panel, arm) not in curves:
                continue
            steps, percent = np.moveaxis(np.array(curves[panel, arm]), -1, 0)
            colour, style = COLOURS[k % len(COLOURS)], "dashed" if k >= len(COLOURS) else "solid"
            axes.plot(steps[0], percent.mean(0), color=colour, linestyle=style, label=arm)
            axes.fill_between(steps[0], percent.min(0), percent.max(0), color=colour, alpha=0.2, linewidth=0)
        axes.set_xlim(left=0.0)
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
        axes.set_ylim(-3, 103)
        axes.set_xlabel("environment steps")
        axes.set_ylabel("success (%)")

    return in_panels({panel: panel for panel, _ in curves}, draw)


def time_shares(rows: Rows, parts: Mapping[str, str], *, named_by: Sequence[str], title: str, unit: str) -> str:
    """Draw how time divides: one stacked bar per row.

    Args:
        rows: with one number per part. parts: column -> name, to stack in order. named_by: columns whose values name a
            row. title: of the figure. unit: what the numbers are.
    """

    def draw(axes: Axes, _: str) -> None:
        start = [0.0] * len(rows)
        for k, (column, name) in enumerate(parts.items()):
            widths = [r[column] for r in rows]
            axes.barh(range(len(rows)), widths, 0.6, left=start, color=COLOURS[k % len(COLOURS)], label=name)
            start = [a + b for a, b in zip(start, widths, strict=True)]
        axes.set_yticks(range(len(rows)), ["\n".join(r[column] for column in named_by) for r in rows])
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.set_xlabel(unit)
        axes.grid(axis="y", visible=False)

    return in_panels({"": title}, draw, width=2.0, height=max(1.0, ROW_IN * len(rows) * len(named_by) / PANEL_IN[1]))


def spectra(frequency_hz: Sequence[float], measured: Mapping[str, Sequence[float]], theory: Mapping[str, Any]) -> str:
    """Draw power spectra over frequency, a panel per component: dots measured, line from theory.

    Args:
        frequency_hz: (F,). measured, theory: component -> (F,) density, m²/s² per Hz.
    """

    def draw(axes: Axes, component: str) -> None:
        axes.plot(frequency_hz, measured[component], "o", color=COLOURS[0], markersize=3, label="simulated")
        axes.plot(frequency_hz, theory[component], color=INK, linewidth=1, label="Dryden")
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("frequency (Hz)")
        axes.set_ylabel("density (m²/s²/Hz)")

    return in_panels({component: component for component in measured}, draw)


def force_lines(time_s: Sequence[float], percent: Mapping[str, Mapping[str, Sequence[float]]]) -> str:
    """Draw forces along the mean wind over time, a panel per robot, a line per tier.

    Args:
        time_s: (T,). percent: robot -> tier -> (T,) force as a percentage of weight.
    """

    def draw(axes: Axes, robot: str) -> None:
        for k, (tier, values) in enumerate(percent[robot].items()):
            axes.plot(time_s, values, color=COLOURS[k], linewidth=1, label=tier)
        axes.set_xlabel("time (s)")
        axes.set_ylabel("drag (% of weight)")
        axes.set_ylim(bottom=0.0)

    return in_panels({robot: robot for robot in percent}, draw)


def step_lines(time_s: Sequence[float], percent: Mapping[tuple[str, str], Mapping[str, Sequence[float]]]) -> str:
    """Draw step responses: a panel per robot and step, a line per flight law.

    Args:
        time_s: (T,) since the step. percent: (robot, step) -> law -> (T,) response as a percentage of the step.
    """

    def draw(axes: Axes, panel: tuple[str, str]) -> None:
        for k, (law, values) in enumerate(percent[panel].items()):
            axes.plot(time_s, values, color=COLOURS[k], linewidth=1.2, label=law)
        axes.axhline(100.0, color=INK, linestyle="dashed", linewidth=1)
        axes.set_xlabel("time (s)")
        axes.set_ylabel("response (%)")

    return in_panels({panel: f"{panel[0]}, {panel[1]}" for panel in percent}, draw)


def mismatch_lines(rmse_cm: Mapping[str, Mapping[str, Sequence[tuple[float, float, bool]]]]) -> str:
    """Draw how well a position is held by a vehicle that is not as expected: a panel per difference, a line per pilot.

    Args:
        rmse_cm: what differs -> pilot -> (factor, cm up to a crash, whether some flight crashed; such points are
            hollow).
    """
    from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter

    def draw(axes: Axes, what: str) -> None:
        for k, (pilot, points) in enumerate(rmse_cm[what].items()):
            colour = COLOURS[k % len(COLOURS)]
            x, y, crashed = zip(*points, strict=True) if points else ((), (), ())
            axes.plot(x, y, color=colour, linewidth=1.2, label=pilot)
            axes.scatter(
                x, y, 12, color=["white" if hollow else colour for hollow in crashed], edgecolors=colour, zorder=3
            )
        if any(hollow for pilots in rmse_cm.values() for points in pilots.values() for *_, hollow in points):
            axes.scatter([], [], 12, color="white", edgecolors=INK, label="some flights crashed: RMSE up to the crash")
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.set_xlabel(f"factor of {what}")
        axes.set_ylabel("distance, RMSE (cm)")

    return in_panels({what: what for what in rmse_cm}, draw)
