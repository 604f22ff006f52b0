"""The figures of a report as matplotlib figures: success, learning curves, returns, time to success, two policies."""

import io
import os
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng
from aerial_il.evaluation import statistics
from aerial_il.evaluation.compare import compare
from aerial_il.evaluation.training_run import TrainingRun, read_run
from aerial_il.presentation.analysis.flights import Evaluation, read
from aerial_il.presentation.pages.run_figures import mean_success, unit_of

# Seven hues that people with any colour vision tell apart; M. Okabe and K. Ito, "Color Universal Design", 2008.
HUES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
Runs = Mapping[str, Sequence[str | os.PathLike[str]]]  # label -> folders of runs that only differ in seed


class _NotebookFigure(Figure):
    """A figure that a notebook draws by itself, without pyplot having been used there before."""

    def _repr_png_(self) -> bytes:
        drawn = io.BytesIO()
        self.savefig(drawn, format="png", dpi=90)
        return drawn.getvalue()


def use_style() -> None:
    """Set matplotlib's colours, grid and sizes for all figures that follow, as those of this package have them."""
    for name, value in _style().items():
        mpl.rcParams[name] = value


def success(evaluations: Mapping[str, Evaluation]) -> Figure:
    """Draw the success of each evaluation, by its label, with Wilson's 95 % interval and the number of flights."""
    _some(evaluations)
    results = {label: read(one) for label, one in evaluations.items()}
    figure, axes = _figure(height=0.9 + 0.5 * len(results))
    for row, result in enumerate(results.values()):
        rate, (low, high) = result.success["rate"], result.success["ci95"]
        bars = 100 * np.array([[rate - low], [high - rate]])
        axes.errorbar(100 * rate, row, xerr=bars, fmt="o", capsize=4, color=HUES[row % len(HUES)])
    labels = [f"{label}\n{r.success['count']} of {len(r.episodes)} flights" for label, r in results.items()]
    axes.set(xlim=(-2, 102), ylim=(len(results) - 0.5, -0.5), xlabel="success (%), 95 % Wilson interval")
    axes.set_yticks(range(len(results)), labels)
    return figure


def learning_curves(runs: Runs) -> Figure:
    """Draw success in the rollouts on the way: a hue per label, thick the mean over its runs, thin each of them.

    The interval is Wilson's for one run; for several it resamples runs, then episodes.

    Raises:
        InvalidValueError: one is no run, or a label has no step at which all of its runs were flown.
    """
    _some(runs)
    groups = {label: [read_run(path) for path in paths] for label, paths in runs.items()}
    figure, axes = _figure()
    for hue, (label, members) in zip(_hues(groups), groups.items(), strict=True):
        points = mean_success(members)
        if not points:
            raise InvalidValueError(f"{label!r}: its runs share no rollouts on the way; train with evaluate_every=N.")
        each = [([r.step for r in run.rollouts], [100 * r.rate for r in run.rollouts]) for run in members]
        mean = np.array([(s, 100 * rate, *(100 * end for end in interval or ())) for s, rate, interval in points])
        _draw_bundle(axes, hue, label, each, mean.T, marker="o")
    axes.set(ylim=(-2, 102), ylabel="success (%), band: 95 %", xlabel=unit_of(r for m in groups.values() for r in m))
    axes.legend()
    return figure


def curves(runs: Runs, number: str = "episode/return", *, over: str = "step") -> Figure:
    """Draw any number that runs logged: a hue per label, thick the mean over its runs, thin each of them.

    Args:
        runs: of any algorithm. number: a column of :func:`aerial_il.presentation.analysis.metrics`.
        over: the column to draw it over, one that grows from row to row, e.g. ``elapsed_s``.

    The mean is drawn where all runs of a label have values, which are joined by straight lines; the band is from the
    worst of several runs to the best, no interval.

    Raises:
        InvalidValueError: one is no run, or did not log both numbers.
    """
    _some(runs)
    figure, axes = _figure()
    groups = {label: [read_run(path) for path in paths] for label, paths in runs.items()}
    for hue, (label, members) in zip(_hues(groups), groups.items(), strict=True):
        drawn = [_curve(run, number, over) for run in members]
        start, end = max(x[0] for x, _ in drawn), min(x[-1] for x, _ in drawn)
        grid = np.unique([p for x, _ in drawn for p in x if start <= p <= end])
        if not len(grid):
            raise InvalidValueError(f"{label!r}: its runs logged {number!r} at no common stretch of {over!r}.")
        each = np.array([np.interp(grid, x, y) for x, y in drawn])
        _draw_bundle(axes, hue, label, drawn, (grid, each.mean(axis=0), each.min(axis=0), each.max(axis=0)), lw=2)
    x_label = unit_of(r for members in groups.values() for r in members) if over == "step" else over
    axes.set(ylabel=number, xlabel=x_label)
    axes.legend()
    return figure


def returns(evaluations: Mapping[str, Evaluation]) -> Figure:
    """Draw the return of every flight of each evaluation, and the mean with its 95 % bootstrap interval."""
    _some(evaluations)
    figure, axes = _figure()
    for place, (label, one) in enumerate(evaluations.items()):
        episodes, hue = read(one).episodes, HUES[place % len(HUES)]
        values = np.array([episode.return_ for episode in episodes])
        rng = named_rng(0, "analysis", "returns", label)
        low, high = statistics.bootstrap_mean(values, rng=rng)
        axes.plot(place + rng.uniform(-0.15, 0.15, len(values)), values, "o", ms=3, alpha=0.35, color=hue)
        bars = [[values.mean() - low], [high - values.mean()]]
        axes.errorbar(place + 0.25, values.mean(), yerr=bars, fmt="D", ms=5, capsize=4, color=hue)
    axes.set_xticks(range(len(evaluations)), [f"{label}\n{len(read(o).episodes)}" for label, o in evaluations.items()])
    axes.set(ylabel="return", xlabel="policy, number of flights; diamond: mean with 95 % interval")
    return figure


def survival(evaluations: Mapping[str, Evaluation]) -> Figure:
    """Draw the share of flights that have succeeded by each moment; one that never does stays unsolved for good."""
    _some(evaluations)
    figure, axes = _figure()
    for hue, (label, one) in zip(_hues(evaluations), evaluations.items(), strict=True):
        episodes = read(one).episodes
        times = sorted(e.time_to_success_s for e in episodes if e.success and e.time_to_success_s is not None)
        end = max(*times, *(episode.duration_s for episode in episodes), 0.0)
        x, y = [0.0, *times, end], [0, *range(1, len(times) + 1), len(times)]
        axes.step(x, 100 * np.array(y) / len(episodes), where="post", color=hue, label=f"{label} ({len(episodes)})")
    axes.set(xlabel="time since the start (s)", ylabel="flights that have succeeded (%)", ylim=(-2, 102))
    axes.legend(title="number of flights")
    return figure


def paired_comparison(a: Evaluation, b: Evaluation) -> Figure:
    """Draw what became of the seeds that two policies both flew, and the difference in success with its interval.

    Raises:
        InvalidValueError: they did not fly the same seeds of one robot, task and tier.
    """
    result, total = compare(read(a), read(b)), len(read(a).episodes)
    if not result.paired:
        raise InvalidValueError("The two did not fly the same seeds in the same tier; evaluate both on the same seeds.")
    only_a, only_b = len(result.only_a), len(result.only_b)
    both = round(result.rate_a * total) - only_a
    figure, (counts, difference) = _figures(2, height=2.6)
    kinds = {"both": both, "a alone": only_a, "b alone": only_b, "neither": total - both - only_a - only_b}
    bars = counts.barh(list(kinds), list(kinds.values()), color=(HUES[2], HUES[0], HUES[1], "0.6"))
    counts.bar_label(bars, padding=2)
    counts.set(xlabel=f"of {total} seeds", title=f"a: {result.a}\nb: {result.b}", xlim=(0, 1.15 * total))
    counts.invert_yaxis()
    bar = 100 * np.array([[result.difference - result.ci95.lo], [result.ci95.hi - result.difference]])
    difference.errorbar(100 * result.difference, 0, xerr=bar, fmt="o", capsize=4, color=HUES[6])
    difference.axvline(0, color="0.5", lw=1)
    difference.set(xlabel="b - a, points of success, 95 %", yticks=[], title=f"p = {result.p_value:.2g} (McNemar)")
    return figure


def _curve(run: TrainingRun, number: str, over: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the values of ``over`` and of ``number`` in the rows of a run that have both."""
    points = [(row[over], row[number]) for row in run.rows if number in row and over in row]
    points = np.array(points, dtype=float).reshape(-1, 2)
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        logged = ", ".join(sorted({name for row in run.rows for name in row})) or "nothing yet"
        raise InvalidValueError(f"{run.path} has no row with both {number!r} and {over!r}; it logged {logged}.")
    return points[:, 0], points[:, 1]


def _style() -> dict[Any, Any]:
    cycle = cycler(color=HUES)
    grid = {"axes.grid": True, "grid.color": "0.9", "axes.axisbelow": True}
    frame = {"axes.spines.top": False, "axes.spines.right": False}
    return {"axes.prop_cycle": cycle, **grid, **frame, "font.size": 10, "figure.dpi": 90, "savefig.bbox": "tight"}


def _figure(*, height: float = 3.4) -> tuple[Figure, Axes]:
    figure, (axes,) = _figures(1, height=height)
    return figure, axes


def _figures(columns: int, *, height: float) -> tuple[Figure, list[Axes]]:
    """Return a figure of ``columns`` axes that belongs to no window, so that a notebook draws it just once."""
    with mpl.rc_context(_style()):
        figure = _NotebookFigure(figsize=(6.4 if columns == 1 else 4.2 * columns, height), layout="constrained")
        return figure, [figure.add_subplot(1, columns, k + 1) for k in range(columns)]


def _draw_bundle(axes: Axes, hue: str, label: str, each: Sequence[Any], mean: Any, **look: Any) -> None:
    """Draw the line of every run thin, and their mean thick in its band; ``mean``: x, y, and the ends of the band."""
    for x, y in each if len(each) > 1 else ():
        axes.plot(x, y, color=hue, lw=0.8, alpha=0.5)
    x, y, low, high = mean
    axes.plot(x, y, color=hue, label=f"{label} ({len(each)} run{'s'[: len(each) > 1]})", **look)
    axes.fill_between(x, low, high, color=hue, alpha=0.15, lw=0)


def _hues(labels: Mapping[str, Any]) -> list[str]:
    return [HUES[k % len(HUES)] for k in range(len(labels))]


def _some(given: Mapping[str, Any]) -> None:
    if not given:
        raise InvalidValueError("There is nothing to draw; give at least one, as {'label': path}.")
