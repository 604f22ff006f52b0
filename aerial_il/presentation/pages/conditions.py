"""One page about policies under conditions: what each disturbance costs, what fails, where, and how it looks."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from aerial_il.evaluation.failures import kind_of, kinds_of
from aerial_il.evaluation.laboratory import Laboratory, Row, profile
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.presentation.films.video import Clip, embedded
from aerial_il.presentation.pages.charts import HEIGHT, NARROW, WIDE, Figure, Plot, equal_height
from aerial_il.presentation.pages.page import words, write_page

Flown = Mapping[str, Mapping[str, Sequence[EvaluationResult]]]  # method -> condition -> one of each training
Starts = Mapping[int, tuple[str, float, float]]  # seed -> what is where when it starts, x and y in m
MOST_MAPS, MOST_FILMS, FEWEST_RUNS = 24, 12, 3
NUMBER_OF_HUES = 8


def write_conditions(
    path: str | os.PathLike[str],
    laboratory: Laboratory,
    flown: Flown,
    *,
    starts: Mapping[str, Starts],
    films: Sequence[tuple[str, Clip]] = (),
    command: str = "",
) -> Path:
    """Write the page.

    Args:
        path: destination, an HTML file. laboratory: the comparison. flown: the evaluations that it compares.
        starts: task -> where its flights start. films: what each shows, and the film. command: what leads here.
    """
    hues = {method: k % NUMBER_OF_HUES for k, method in enumerate(flown)}
    shown = [(said, film) for said, clip in _spread(films, MOST_FILMS) for film in embedded([clip])]
    maps = _maps(flown, starts)
    return write_page(
        path,
        "conditions.html.j2",
        laboratory=laboratory,
        hues=hues,
        cells=[(cell, words(cell[1]), rows, _success(rows, hues)) for cell, rows in _by_cell(laboratory).items()],
        profile=_profiles(laboratory, hues),
        failures=[(row, _shares(row)) for row in laboratory.rows if row.failures],
        maps=_spread(maps, MOST_MAPS),
        films=shown,
        left_out={"maps": max(0, len(maps) - MOST_MAPS), "films": max(0, len(films) - MOST_FILMS)},
        command=command,
    )


def _spread[Item](items: Sequence[Item], most: int) -> list[Item]:
    """Return at most so many items, evenly spread over all of them."""
    if len(items) <= most:
        return list(items)
    return [items[int(k)] for k in np.linspace(0, len(items) - 1, most).round()]


def typical_failure(result: EvaluationResult, clips: Sequence[Clip]) -> Clip | None:
    """Return the film of a failure of the most frequent kind that was filmed, or None where no failure was."""
    order = list(kinds_of(result.episodes))
    failed = [clip for clip in clips if not clip.episode.success]
    return min(failed, key=lambda clip: order.index(kind_of(clip.episode)), default=None)


def _by_cell(laboratory: Laboratory) -> dict[tuple[str, str], list[Row]]:
    cells: dict[tuple[str, str], list[Row]] = {}
    for row in laboratory.rows:
        cells.setdefault((row.robot, row.task), []).append(row)
    return cells


def _success(rows: Sequence[Row], hues: Mapping[str, int]) -> Figure:
    """Draw success under each condition with its interval, a hue for each method."""
    conditions = list(dict.fromkeys(row.condition for row in rows))
    said = "; ".join(f"{row.method}, {row.condition}: {100 * row.rate:.0f} %" for row in rows)
    places = [float(k) for k in range(1, len(conditions) + 1)]
    plot = Plot(
        x=(0.5, len(conditions) + 0.5), y=(0.0, 1.0), x_label="condition", y_label="", alt=f"Success. {said}",
        width=2 * WIDE, height=HEIGHT, percent=True, x_ticks=places,
    )  # fmt: skip
    aside = 0.5 / max(len(hues), 1)
    for row in rows:
        place = 1 + conditions.index(row.condition) + aside * (list(hues).index(row.method) - (len(hues) - 1) / 2)
        hue = f"hue{hues[row.method]}"
        plot.whisker(place, *row.ci95, f"reach {hue}")
        plot.dot(
            place, row.rate, f"spot {hue}", radius=4, title=f"{row.method}, {row.condition}: {100 * row.rate:.1f} %"
        )
    numbered = "; ".join(f"{k}: {condition}" for k, condition in enumerate(conditions, 1))
    return Figure("Success with its 95 % interval", plot.svg(), numbered)


def _profiles(laboratory: Laboratory, hues: Mapping[str, int]) -> Figure | None:
    """Draw the performance profile of each method over its trainings and conditions; None of too few."""
    if max(len(each) for of in laboratory.rates.values() for each in of.values()) < FEWEST_RUNS:
        return None
    pooled = {method: [rate for each in of.values() for rate in each] for method, of in laboratory.rates.items()}
    plot = Plot(
        x=(0.0, 1.0), y=(0.0, 1.0), x_label="success", y_label="", percent=True, width=2 * WIDE, height=HEIGHT,
        alt="Share of trainings and conditions with at least as much success: "
        + "; ".join(f"{method}: half have {100 * float(np.median(rates)):.0f} %" for method, rates in pooled.items()),
    )  # fmt: skip
    for method, rates in pooled.items():
        plot.line(*profile(rates), f"trace hue{hues[method]}", title=method)
    note = "The higher, the better: the share of all trainings and conditions whose success is at least that."
    return Figure("Performance profile", plot.svg(), note)


def _shares(row: Row) -> list[tuple[str, int, float]]:
    """Return kind, count and share of all flights of the failures of a row."""
    return [(kind, count, count / row.episodes) for kind, count in row.failures.items()]


def _maps(flown: Flown, starts: Mapping[str, Starts]) -> list[Figure]:
    """Draw, seen from above, from which starts each method failed under each condition."""
    return [
        _map(f"{method}, {condition}" if len(flown) > 1 else condition, task, results, starts[task])
        for method, of in flown.items()
        for condition, results in of.items()
        for task in dict.fromkeys(result.task for result in results)
        if task in starts
    ]


def _map(title: str, task: str, results: Sequence[EvaluationResult], starts: Starts) -> Figure:
    places = np.array([place for _, *place in starts.values()], float)
    x, y = ((float(column.min()), float(column.max())) for column in places.T)
    episodes = [episode for result in results if result.task == task for episode in result.episodes]
    lost = sum(not episode.success for episode in episodes)
    alt = f"{title}: {lost} of {len(episodes)} flights failed"
    height = equal_height(x, y, width=NARROW)
    plot = Plot(x=x, y=y, x_label="x (m)", y_label="y (m)", alt=alt, height=height)
    for episode in sorted(episodes, key=lambda each: not each.success):  # failures above successes
        _, across, up = starts[episode.seed]
        called = f"seed {episode.seed}: {kind_of(episode) or 'success'}"
        mark, kind = (plot.dot, "end good") if episode.success else (plot.cross, "end bad")
        mark(across, up, kind, title=called)
    what = next(iter(starts.values()))[0]
    title = f"{title}, {words(task)}" if len({result.task for result in results}) > 1 else title
    return Figure(title, plot.svg(), f"{words(what)} at the start, from above; {lost} of {len(episodes)} failed")
