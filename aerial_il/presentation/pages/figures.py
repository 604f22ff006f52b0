"""The charts of a report, each drawn from an evaluation, a training run or a learning curve."""

from collections.abc import Sequence

import numpy as np

from aerial_il.evaluation.curves import Curve, LearningPoint
from aerial_il.evaluation.metrics import EpisodeRecord, Metric, metrics_of
from aerial_il.evaluation.result import EvaluationResult, Flight
from aerial_il.presentation.pages.charts import HEIGHT, WIDE, Figure, Plot, equal_height, histogram, tick_label

KINDS = {"success": "good", "failure": "bad"}
MOST_PATHS = 60  # of each outcome, so that the drawing stays readable and small
CENTIMETRES = 100.0
CLOCK = "elapsed_s"
SPELT_OUT = {"lr": "learning rate", "grad_norm": "gradient norm"}
SPREAD_OUT = ("ee_error_mean_m", "ee_error_max_m", "effort_mean", "action_jerk_rms")


def display(metric: Metric) -> tuple[str, str, float]:
    """Return label, unit and factor with which people read a metric: centimetres for metres, raised powers."""
    if metric.unit == "m":
        return metric.label, "cm", CENTIMETRES
    return metric.label, metric.unit.replace("^3", "³").replace("^4", "⁴"), 1.0


def distributions(result: EvaluationResult) -> list[Figure]:
    """Draw the time to success, then error, effort and smoothness over all episodes, split by outcome."""
    metrics = {metric.key: metric for metric in metrics_of(result.episodes)}
    keys = [key for key in metrics if key.startswith(SPREAD_OUT)]
    figures = [_distribution(metrics[key], result.episodes) for key in ("time_to_success_s", *keys)]
    return [figure for figure in figures if figure is not None]


def _distribution(metric: Metric, episodes: Sequence[EpisodeRecord]) -> Figure | None:
    label, unit, factor = display(metric)
    groups: dict[str, list[float]] = {}
    for episode in episodes:
        value = metric.value(episode)
        if value is not None:
            groups.setdefault("success" if episode.success else "failure", []).append(factor * value)
    if not groups:
        return None
    ordered = {name: groups[name] for name in KINDS if name in groups}
    return histogram(label, ordered, x_label=unit, kinds=KINDS)


def paths(result: EvaluationResult) -> list[Figure]:
    """Draw the end effector's paths from above and from the side; empty where none was observed."""
    flights = [(e, result.flights[e.seed]) for e in result.episodes if e.seed in result.flights]
    flights = [(episode, flight) for episode, flight in flights if len(flight.ee_path) > 1]
    chosen = [pair for won in (True, False) for pair in [p for p in flights if p[0].success is won][:MOST_PATHS]]
    if not chosen:
        return []
    left_out = len(flights) - len(chosen)
    note = f"The first {MOST_PATHS} of each outcome; {left_out} more are not drawn." if left_out else ""
    views = (("End effector from above", "y", 1), ("End effector from the side", "z", 2))
    return [_path_view(*view, chosen, note) for view in views]


def _path_view(title: str, axis: str, v: int, chosen: list[tuple[EpisodeRecord, Flight]], note: str) -> Figure:
    """Draw paths over x, upwards the column ``v`` of theirs, which is called ``axis``."""
    points = np.concatenate([flight.ee_path for _, flight in chosen])
    x, y = (_padded(points[:, k]) for k in (0, v))
    alt = f"{title}: {len(chosen)} paths within x {x[0]:.2f} to {x[1]:.2f} m and {axis} {y[0]:.2f} to {y[1]:.2f} m"
    height = equal_height(x, y, width=WIDE)
    plot = Plot(x=x, y=y, x_label="x (m)", y_label=f"{axis} (m)", alt=alt, width=WIDE, height=height)
    for episode, flight in chosen:
        kind, mark = ("good", plot.dot) if episode.success else ("bad", plot.cross)
        path, called = flight.ee_path, f"seed {episode.seed}: {episode.end}"
        plot.line(path[:, 0], path[:, v], f"path {kind}", title=called)
        mark(path[-1, 0], path[-1, v], f"end {kind}", title=called)
    return Figure(title, plot.svg(), note)


def _padded(values: np.ndarray) -> tuple[float, float]:
    lo, hi = float(values.min()), float(values.max())
    return lo - 0.03 * (hi - lo), hi + 0.03 * (hi - lo)


def training(curves: Sequence[Curve], unit: str = "training step") -> list[Figure]:
    """Draw the logged numbers of a training run: those that say how well it learns come first, the clock not at all.

    Args:
        curves: of the run. unit: what its steps count.
    """
    ranked = sorted(
        (curve for curve in curves if curve.name != CLOCK),
        key=lambda c: (not any(word in c.name for word in ("success", "loss")), "/" in c.name),
    )
    return [logged(curve, unit) for curve in ranked]


def logged(curve: Curve, unit: str, *, title: str = "", height: float = HEIGHT) -> Figure:
    """Draw one logged number over training.

    Args:
        curve: what is drawn. unit: what its steps count. title: instead of the curve's name. height: of the drawing.
    """
    lo, hi = float(curve.values.min()), float(curve.values.max())
    log = "loss" in curve.name and lo > 0 and hi > 20 * lo
    last = tick_label(float(curve.values[-1]))
    alt = f"{curve.name} over {curve.steps[-1]:g} {unit}s; last value {last}"
    x = float(curve.steps[0]), float(curve.steps[-1])
    y = lo if log else min(lo, 0.0), hi
    plot = Plot(x=x, y=y, x_label=unit, y_label="", alt=alt, height=height, log_y=log)
    plot.line(curve.steps, curve.values, "curve")
    return Figure(title or spelt(curve.name), plot.svg(), f"Last value {last}")


def spelt(name: str) -> str:
    """Return the name of a logged number as a title: ``grad_norm`` is ``Gradient norm``."""
    title = SPELT_OUT.get(name, name.replace("_", " ").replace("/", ": "))
    return title[0].upper() + title[1:]


def learning_curve(points: Sequence[LearningPoint]) -> Figure:
    """Draw success over the number of demonstrations with 95 % intervals."""
    ordered = sorted(points, key=lambda p: p.demonstrations)
    numbers = [float(p.demonstrations) for p in ordered]
    rates = [p.result.success["rate"] for p in ordered]
    said = ", ".join(f"{100 * r:.0f} % at {n:g}" for n, r in zip(numbers, rates, strict=True))
    x, alt = (numbers[0], numbers[-1]), f"Success over demonstrations: {said}"
    look = {"width": WIDE, "log_x": True, "x_ticks": numbers, "percent": True}
    plot = Plot(x=x, y=(0.0, 1.0), x_label="demonstrations", y_label="", alt=alt, **look)
    plot.line(numbers, rates, "curve")
    for number, point in zip(numbers, ordered, strict=True):
        lo, hi = point.result.success["ci95"]
        plot.whisker(number, lo, hi, "whisker")
        plot.dot(number, point.result.success["rate"], "knot", radius=3.5, title=point.result.headline())
    return Figure("Success over demonstrations", plot.svg(), "Bars: 95 % Wilson intervals.")
