"""A page about a dataset: what is in it, what it covers, what looks odd, where it came from, how to load it."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from aerial_il.core.specs import UNKNOWN, Field
from aerial_il.data.coverage import Coverage
from aerial_il.data.quality.judge import LIMITS
from aerial_il.data.summary import Summary
from aerial_il.data.table import Row
from aerial_il.evaluation.statistics import wilson
from aerial_il.presentation.pages.charts import Figure, density, histogram, strip
from aerial_il.presentation.pages.page import flat, write_page

KINDS = {"success": "good", "failure": "bad"}
SPLITS = {
    "tag": "Tag",
    "operator": "Operator",
    "tier": "Tier",
    "policy": "Policy",
    "task": "Task",
    "failure": "Failure",
}
MOST_LINES = 12  # of a table
MOST_MAPS = 4  # kinds of places whose starts are drawn
USED = (0.01, 0.99)  # quantiles between which lies what is used of a range
NO_SETTING = ("schema", "sources", "provenance", "command", "made_by")  # of a lineage
DECIMALS = 9  # beyond which a number is the noise of its arithmetic
TOOL, VIEWS = "ee_pos", (("from above", 0, 1), ("from the side", 0, 2))


@dataclass(frozen=True)
class Film:
    """A film of an episode, as an address that holds all of it; ``speed`` times faster than real time."""

    uid: str
    data: str
    speed: int
    why: str = ""


@dataclass(frozen=True)
class Line:
    """Some of the episodes, or of the time: its name, how many, their share, how many of them succeeded."""

    name: str
    count: int
    share: float
    won: int | None = None

    @property
    def rate(self) -> float | None:
        return None if self.won is None else self.won / self.count

    @property
    def interval(self) -> tuple[float, float] | None:
        """Wilson's 95 % interval of the rate."""
        return None if self.won is None else wilson(self.won, self.count)


@dataclass(frozen=True)
class Strip:
    """Where one element lies: its ends, what is used of its bounds and how often it is at one, and its picture."""

    label: str
    unit: str
    low: float
    high: float
    svg: Markup
    seen: tuple[float, float] | None = None
    used: float | None = None
    at_bound: float | None = None


def write_card(
    path: str | os.PathLike[str],
    summary: Summary,
    *,
    name: str,
    load: Sequence[str],
    films: Sequence[Film] = (),
    film_note: str = "",
    lineage: Mapping[str, Any] | None = None,
    commands: Sequence[str] = (),
) -> Path:
    """Write the page.

    Args:
        path: destination, an HTML file.
        summary: of the dataset. name: of the dataset, as it is typed.
        load: lines of Python that open it. commands: what a reader types to go on from here.
        films: of outliers. film_note: why there are none.
        lineage: what it was made of and how, if it was derived.
    """
    rows, coverage = summary.rows, summary.coverage
    splits = {key: split for key in SPLITS if (split := by(rows, key))}
    return write_page(
        path,
        "card.html.j2",
        name=name,
        spec=coverage.spec,
        rows=rows,
        left_out=summary.left_out,
        assumed=summary.assumed,
        others=coverage.others,
        lengths=lengths(rows),
        splits={SPLITS[key]: split for key, split in splits.items() if len(split) > 1},
        alike={
            SPLITS[key]: split[0].name for key, split in splits.items() if len(split) == 1 and split[0].name != UNKNOWN
        },
        starts=starts(coverage),
        places=places(coverage),
        actions=action_strips(coverage),
        states=state_strips(coverage),
        phases=phases(coverage),
        judged=summary.judged,
        suspects=summary.suspects[:MOST_LINES],
        suspects_in_all=len(summary.suspects),
        measures=[each for each in LIMITS if rows[0].keys() >= {each}],
        films=films,
        film_note=film_note,
        origin=origin(coverage),
        lineage=ancestry(lineage),
        load=load,
        commands=commands,
    )


def lengths(rows: Sequence[Row]) -> Figure:
    """Draw a histogram of the lengths of successes and of failures."""
    groups = {name: [row["seconds"] for row in rows if row["success"] is (name == "success")] for name in KINDS}
    return histogram("Length", groups, x_label="s", kinds=KINDS)


def by(rows: Sequence[Row], key: str) -> list[Line]:
    """Count the episodes by what they have in a column, the most first; none where it tells nothing."""
    groups: dict[str, list[bool]] = {}
    for row in rows:
        groups.setdefault(str(row[key] or ""), []).append(row["success"])
    if not groups.keys() - {""}:
        return []
    lines = [
        Line(name or ("success" if key == "failure" else "–"), len(won), len(won) / len(rows), sum(won))
        for name, won in groups.items()
    ]
    return sorted(lines, key=lambda line: -line.count)


def phases(coverage: Coverage) -> list[Line]:
    """Return the share of the time that is spent in each phase, in their order; none where there is one alone."""
    counts = coverage.phases
    return [Line(name, n, n / coverage.steps) for name, n in counts.items()] if len(counts) > 1 else []


def starts(coverage: Coverage) -> list[Figure]:
    """Draw where the first states of all episodes have the places that vary, from above; failures as crosses."""
    first, solved, figures = coverage.starts, coverage.solved, list[Figure]()
    for field in _places(coverage):
        points = first[:, _slice(coverage, field)][:, :2]
        if np.ptp(points, axis=0).max() > 0 and len(figures) < MOST_MAPS:
            title = f"Start of {field.name}, from above"
            figures.append(density(title, points, x_label="x (m)", y_label="y (m)", crosses=points[~solved]))
    return figures


def places(coverage: Coverage) -> list[Figure]:
    """Draw where the tool has been, from above and from the side; the first place of the robot where it has none."""
    own = [field for field in _places(coverage) if field.group == "proprio"]
    chosen = next((field for field in own if field.name == TOOL), own[0] if own else None)
    if chosen is None:
        return []
    points = coverage.states[:, _slice(coverage, chosen)]
    return [
        density(f"{chosen.name}, {title}", points[:, [u, v]], x_label=f"{'xyz'[u]} (m)", y_label=f"{'xyz'[v]} (m)")
        for title, u, v in VIEWS
    ]


def action_strips(coverage: Coverage) -> list[Strip]:
    """Return where each element of the actions lies within its bounds."""
    bounds, values = coverage.spec.action, coverage.actions
    strips = []
    for k, label in enumerate(bounds.labels):
        least, most = (round(float(ends[k - bounds.size]), DECIMALS) for ends in (coverage.low, coverage.high))
        low, high = float(bounds.low[k]), float(bounds.high[k])
        alt = f"{label}: {least:.3g} to {most:.3g} within its bounds {low:.3g} and {high:.3g}"
        bounded = math.isfinite(high - low)
        used = round(float(np.ptp(np.quantile(values[:, k], USED))) / (high - low), 4) if bounded else None
        at_bound = float(coverage.at_bound[k]) / coverage.steps if bounded else None
        svg = strip(values[:, k], *((low, high) if bounded else (least, most)), alt=alt)
        strips.append(Strip(label, bounds.units[k], low, high, svg, (least, most), used, at_bound))
    return strips


def state_strips(coverage: Coverage) -> list[Strip]:
    """Return where each element of the states lies between its ends."""
    observed, values = coverage.spec.observation, coverage.states
    labelled = [
        (label, observed[name].unit) for name in observed.state_names for label in observed[name].element_labels()
    ]
    strips = []
    for k, (label, unit) in enumerate(labelled):
        low, high = (round(float(ends[k]), DECIMALS) for ends in (coverage.low, coverage.high))
        strips.append(
            Strip(label, unit, low, high, strip(values[:, k], low, high, alt=f"{label}: {low:.3g} to {high:.3g}"))
        )
    return strips


def origin(coverage: Coverage) -> list[tuple[str, str]]:
    """Return each entry of the provenance and what the episodes have in it, with their number where they differ."""
    said = []
    for key, counted in coverage.origin.items():
        alike = len(counted) == 1 and counted.total() == coverage.episodes
        values = [value if alike else f"{value} ({count})" for value, count in counted.most_common()]
        said += [(key, ", ".join(values))] if values else []
    return said


def ancestry(lineage: Mapping[str, Any] | None) -> list[tuple[str, str]]:
    """Return how a dataset was made, then each of its sources and how that one was made, the nearest first."""
    if not lineage:
        return []
    own = {key: value for key, value in lineage.items() if key not in NO_SETTING}
    said = [(str(lineage.get("command", "made")), ", ".join(f"{key}={value}" for key, value in flat(own)) or "–")]
    for source in lineage.get("sources", ()):
        said.append(("from", f"{source['episodes']} episodes of {source['path']}"))
        said += ancestry(source.get("lineage"))
    return said


def _places(coverage: Coverage) -> list[Field]:
    """Return the fields that are places: three numbers in metres."""
    observed = coverage.spec.observation
    return [f for f in map(observed.__getitem__, observed.state_names) if f.shape == (3,) and f.unit == "m"]


def _slice(coverage: Coverage, field: Field) -> slice:
    observed = coverage.spec.observation
    ends = np.cumsum([observed[name].size for name in observed.state_names])
    last = int(ends[observed.state_names.index(field.name)])
    return slice(last - field.size, last)
