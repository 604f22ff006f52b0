"""The charts of a training run, and of several runs that differ in seed or settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from aerial_il.core.seeding import named_rng
from aerial_il.evaluation import statistics
from aerial_il.evaluation.background import Curve, curves_of
from aerial_il.evaluation.charts import NARROW, WIDE, Figure, Plot, tick_label
from aerial_il.evaluation.figures import CLOCK, training
from aerial_il.evaluation.predictions import Prediction
from aerial_il.evaluation.training_run import Rollouts, TrainingRun

LOSSES = ("loss", "validation/loss")
CHART_POINTS = 400  # of a prediction; more are not seen
SMALL, TALL = 130.0, 260.0  # heights of one of many charts, and of one that stands alone


def success(rollouts: Sequence[Rollouts]) -> Figure:
    """Draw success in the rollouts over training, with 95 % intervals; the best one is marked, the last one told."""
    steps, rates = [float(r.step) for r in rollouts], [r.rate for r in rollouts]
    last = rollouts[-1]
    alt = f"Success in rollouts over {last.step} training steps; at the end {100 * last.rate:.0f} %"
    plot = _success_axes(steps[-1], alt)
    plot.line(steps, rates, "curve")
    for step, point in zip(steps, rollouts, strict=True):
        plot.whisker(step, *point.ci95, "whisker")
        plot.dot(step, point.rate, "knot", radius=3.5, title=f"step {point.step}: {100 * point.rate:.0f} %")
    best = max(rollouts, key=lambda r: (r.rate, r.step))
    note = (
        f"Bars: 95 % Wilson intervals, {last.episodes} episodes each. Best {100 * best.rate:.0f} % at step {best.step}"
    )
    note += f", final {100 * last.rate:.0f} %. The best of several is told too high: judge the final policy."
    return Figure("Success over training", plot.svg(), note)


def _success_axes(last_step: float, alt: str) -> Plot:
    x, y, label = (0.0, last_step), (0.0, 1.0), "training step"
    return Plot(x=x, y=y, x_label=label, y_label="", alt=alt, width=2 * WIDE, height=TALL, percent=True)


def losses(runs: Mapping[str, Sequence[TrainingRun]]) -> Figure | None:
    """Draw the losses over training: of one run its own and that on held-out demonstrations, else a hue per group."""
    lines: list[tuple[str, str, Curve]] = []
    for hue, (label, members) in enumerate(runs.items()):
        for run in members:
            found = {curve.name: curve for curve in curves_of(run.rows)}
            names = LOSSES if len(runs) == 1 else LOSSES[:1]
            for k, name in enumerate(names):
                if name in found:
                    lines.append((f"trace hue{(hue + k) % 8}", f"{label}: {name}", found[name]))
    if not lines:
        return None
    every = np.concatenate([curve.values for _, _, curve in lines])
    low, high = float(every.min()), float(every.max())
    last = max(float(curve.steps[-1]) for _, _, curve in lines)
    log = low > 0 and high > 5 * low
    said = "; ".join(f"{title} ends at {tick_label(float(curve.values[-1]))}" for _, title, curve in lines)
    x, y = (0.0, last), (low if log else 0.0, high)
    label = "training step"
    plot = Plot(x=x, y=y, x_label=label, y_label="", alt=said, width=2 * WIDE, height=TALL, log_y=log)
    for kind, title, curve in lines:
        plot.line(curve.steps, curve.values, kind, title=title)
    return Figure("Loss", plot.svg(), "Which of two policies flies better, no loss tells: only rollouts do.")


def others(run: TrainingRun) -> list[Figure]:
    """Draw what else was logged."""
    shown = (*LOSSES, CLOCK)
    curves = [
        c for c in curves_of(run.rows) if c.name not in shown and not c.name.startswith(("validation/", "evaluate/"))
    ]
    return training(curves)


def validation(run: TrainingRun) -> list[Figure]:
    """Draw the error on held-out demonstrations, element by element of the action, over training."""
    curves = [c for c in curves_of(run.rows) if c.name.startswith("validation/") and c.name != LOSSES[1]]
    figures = []
    for curve in curves:
        name, last = curve.name.removeprefix("validation/"), float(curve.values[-1])
        alt = f"Mean absolute error of {name} over training; last {tick_label(last)}"
        x, y = (0.0, float(curve.steps[-1])), (0.0, float(curve.values.max()))
        plot = Plot(x=x, y=y, x_label="training step", y_label="", alt=alt, width=NARROW, height=SMALL)
        plot.line(curve.steps, curve.values, "curve")
        figures.append(Figure(name, plot.svg(), f"Last value {tick_label(last)}"))
    return figures


def prediction(shown: Prediction) -> list[Figure]:
    """Draw each element of the action along a held-out demonstration: the demonstrator's, and the policy's chunks."""
    figures = []
    step = max(1, len(shown.time_s) // CHART_POINTS)
    for i, (label, unit) in enumerate(zip(shown.labels, shown.units, strict=True)):
        both = np.concatenate([shown.shown[:, i], shown.predicted[:, i]])
        error = float(shown.error[i])
        alt = f"{label} along {shown.uid}: predicted within {tick_label(error)} {unit} of what was shown, on average"
        y = float(both.min()), float(both.max())
        x = float(shown.time_s[0]), float(shown.time_s[-1])
        plot = Plot(x=x, y=y, x_label="s", y_label=unit, alt=alt, width=NARROW, height=1.2 * SMALL)
        plot.line(shown.time_s[::step], shown.shown[::step, i], "trace hue0", title="demonstrator")
        for a, b in zip(shown.starts, [*shown.starts[1:], len(shown.time_s)], strict=True):
            plot.line(shown.time_s[a:b], shown.predicted[a:b, i], "trace hue1", title="policy")
        figures.append(Figure(label, plot.svg(), f"Mean absolute error {tick_label(error)} {unit}".rstrip()))
    return figures


def success_of_groups(groups: Mapping[str, Sequence[TrainingRun]]) -> Figure | None:
    """Draw success over training for runs of several seeds: a hue per group, its mean with intervals, each seed thin.

    The interval resamples training seeds, then episodes; with one seed, the episodes alone.
    """
    flown = {label: [run for run in runs if run.rollouts] for label, runs in groups.items()}
    flown = {label: runs for label, runs in flown.items() if runs}
    if not flown:
        return None
    last = max(run.rollouts[-1].step for runs in flown.values() for run in runs)
    ends = ", ".join(f"{label} {100 * mean_success(runs)[-1][1]:.0f} %" for label, runs in flown.items())
    plot = _success_axes(float(last), f"Success over training, mean over seeds: {ends} at the end")
    for hue, (label, runs) in enumerate(flown.items()):
        for run in runs if len(runs) > 1 else []:
            x, y = [float(r.step) for r in run.rollouts], [r.rate for r in run.rollouts]
            plot.line(x, y, f"trace thin hue{hue % 8}", title=f"{label}, seed {run.seed}")
        means = mean_success(runs)
        plot.line([s for s, _, _ in means], [rate for _, rate, _ in means], f"trace hue{hue % 8}", title=label)
        for step, rate, (low, high) in means:
            plot.whisker(step, low, high, f"reach hue{hue % 8}")
            plot.dot(step, rate, f"spot hue{hue % 8}", radius=3.5, title=f"{label}, step {step:g}: {100 * rate:.0f} %")
    note = "Thick: mean over training seeds; thin: each of them. Bars: 95 % intervals, resampling seeds and episodes."
    return Figure("Success over training", plot.svg(), note)


def mean_success(runs: Sequence[TrainingRun]) -> list[tuple[float, float, statistics.Interval]]:
    """Return (step, mean success, 95 % interval) for every step at which all of ``runs`` were evaluated."""
    told = [{r.step: r for r in run.rollouts} for run in runs]
    common = sorted(set.intersection(*(set(one) for one in told))) if told else []
    means = []
    for step in common:
        points = [one[step] for one in told]
        episodes = min(point.episodes for point in points)
        rate = float(np.mean([point.rate for point in points]))
        counts = [round(point.rate * episodes) for point in points]
        rng = named_rng(0, "evaluation", "success over training", str(step))
        if len(runs) == 1:
            interval = statistics.Interval(*points[0].ci95)
        else:
            interval = statistics.bootstrap_macro([counts], episodes, rng=rng)
        means.append((float(step), rate, interval))
    return means
