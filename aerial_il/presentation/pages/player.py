"""A page on which one flight is watched: its film, and beside it every trace with a line that moves with the film."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from aerial_il.data.episode import Episode
from aerial_il.presentation.films.video import end_of, phase_at
from aerial_il.presentation.pages.charts import LEFT, NARROW, RIGHT, Plot, equal_height
from aerial_il.presentation.pages.page import END_WORDS, data_uri, flat, write_page
from aerial_il.presentation.pages.trace_plots import XYZ, TracePlot, trace_plots

MOST_POINTS = 400  # of a trace that are kept on the page
HEIGHT = 150.0
PATHS = (("ee", "End effector"), ("base", "Base"))
VIEWS = (("From above", 0, 1), ("From the side", 0, 2))


@dataclass(frozen=True)
class Span:
    """A stretch of time on the timeline, in shares of the flight."""

    start: float
    end: float
    name: str = ""
    hue: int = 0


def write_player(
    path: str | os.PathLike[str],
    episode: Episode,
    *,
    flags: np.ndarray | None = None,
    film: Path | None = None,
    note: str = "",
    commands: Sequence[str] = (),
) -> Path:
    """Write the page.

    Args:
        path: destination, an HTML file.
        episode: the flight.
        flags: (T, K) sub-tasks after each step, if they are known.
        film: its film in real time, embedded.
        note: why something is missing, such as the film.
        commands: what a reader types to go on from here.
    """
    points = np.unique(np.linspace(0, len(episode), min(MOST_POINTS, len(episode) + 1)).astype(int))
    times = episode.sim_time[points] - episode.sim_time[0]
    shown = trace_plots(episode)
    origin = dict(episode.provenance)
    return write_page(
        path,
        "player.html.j2",
        spec=episode.spec,
        origin=origin,
        provenance=flat(origin),
        end=end_of(episode),
        end_words=END_WORDS,
        duration_s=float(times[-1]),
        total_reward=episode.total_reward,
        steps=len(episode),
        film=data_uri(film) if film else "",
        note=note,
        charts=[(one, _chart(one, times, points)) for one in shown],
        maps=_maps(episode, points),
        phases=_phases(episode),
        subtasks=_subtasks(episode, flags),
        data=_data(shown, episode, times, points),
        left=LEFT,
        commands=commands,
    )


def _chart(trace_plot: TracePlot, times: np.ndarray, points: np.ndarray) -> Markup:
    low, high = y = trace_plot.range
    alt = f"{trace_plot.title} over time, within {low:.3g} and {high:.3g} {trace_plot.unit}"
    plot = Plot(x=(times[0], times[-1]), y=y, x_label="s", y_label=trace_plot.unit, alt=alt, height=HEIGHT)
    for line in trace_plot.series:
        part = line.values[points]
        known = np.isfinite(part)
        plot.line(times[known], part[known], f"trace hue{line.hue}{' dashed' * line.dashed}", title=line.label)
    plot.rule(times[0], "playhead")
    return plot.svg()


def _maps(episode: Episode, points: np.ndarray) -> list[dict[str, Any]]:
    """Draw the paths from above and from the side, with the places of their moving dots in pixels."""
    paths = [(label, episode.obs[f"{key}_pos"][points]) for key, label in PATHS if f"{key}_pos" in episode.obs]
    if not paths:
        return []
    everything = np.concatenate([path for _, path in paths])
    drawn = []
    for title, u, v in VIEWS:
        x, y = ((float(everything[:, k].min()) - 0.05, float(everything[:, k].max()) + 0.05) for k in (u, v))
        alt = f"{title}: the paths of {' and '.join(label.lower() for label, _ in paths)}"
        labels, height = [f"{XYZ[k]} (m)" for k in (u, v)], equal_height(x, y, width=NARROW)
        plot = Plot(x=x, y=y, x_label=labels[0], y_label=labels[1], alt=alt, width=NARROW, height=height)
        for hue, (label, path) in enumerate(paths):
            plot.line(path[:, u], path[:, v], f"trace hue{hue}", title=label)
            plot.dot(path[0, u], path[0, v], f"spot hue{hue}", radius=4.5)
        places = [[[round(plot.x(p[u]), 1), round(plot.y(p[v]), 1)] for p in path] for _, path in paths]
        drawn.append({"title": title, "svg": plot.svg(), "places": places, "labels": [label for label, _ in paths]})
    return drawn


def _phases(episode: Episode) -> list[Span]:
    edges = [0, *(np.flatnonzero(np.diff(episode.phase)) + 1).tolist(), len(episode)]
    return [
        Span(a / len(episode), b / len(episode), name, int(episode.phase[a]) % 8)
        for a, b in pairwise(edges)
        if (name := phase_at(episode, a))
    ]


def _subtasks(episode: Episode, flags: np.ndarray | None) -> list[tuple[str, list[Span]]]:
    """Return for each sub-task the stretches in which it was done."""
    if flags is None:
        return []
    rows, length = [], len(flags)
    for name, done in zip(episode.spec.subtasks, flags.T, strict=True):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], done, [False]])))
        rows.append((name, [Span(a / length, b / length) for a, b in edges.reshape(-1, 2).tolist()]))
    return rows


def _data(shown: list[TracePlot], episode: Episode, times: np.ndarray, points: np.ndarray) -> dict[str, Any]:
    """Return the data of the page's script: times, the values of every line, and where the axes lie."""
    return {
        "times": times.round(3).tolist(),
        "duration": round(float(times[-1]), 3),
        "step": episode.spec.control_dt_s,
        "values": [[_short(line.values[points]) for line in one.series] for one in shown],
        "width": NARROW - RIGHT - LEFT,
    }


def _short(values: np.ndarray) -> list[float | None]:
    return [float(f"{value:.4g}") if np.isfinite(value) else None for value in values.tolist()]
