"""The charts of a training run, and of several runs that differ in seed or settings."""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from aerial_il.core.seeding import named_rng
from aerial_il.evaluation import statistics
from aerial_il.evaluation.curves import Curve, curves_of
from aerial_il.evaluation.predictions import Prediction
from aerial_il.evaluation.run_collection import axes_of, settings_of
from aerial_il.evaluation.training_run import EPISODES, REWARD, SUCCESS, TrainingRun
from aerial_il.presentation.pages.charts import HEIGHT, NARROW, WIDE, Figure, Plot, tick_label
from aerial_il.presentation.pages.figures import CLOCK, logged, spelt

Groups = Mapping[str, Sequence[TrainingRun]]  # label -> runs that only differ in seed
Each = Mapping[TrainingRun, Sequence[tuple[float, float]]]  # run -> (step, value)
Mean = tuple[float, float, statistics.Interval | None]  # step, mean over seeds, 95 % interval

LOSSES = ("loss", "validation/loss")
SHOWN = (*LOSSES, CLOCK, SUCCESS, f"{SUCCESS}_low", f"{SUCCESS}_high", EPISODES, REWARD)  # in charts of their own
SUCCESS_TITLE, REWARD_TITLE = "Success over training", "Mean reward over training"
HEADINGS = {  # prefix of a number's name -> what stands above the charts, in their order
    "": "Training",
    "total": "Of all rounds so far",
    "evaluate": "Rollouts on the way",
    "evaluate/success": "Their success in each task",
    "episode": "Episodes flown while it learned",
    "reward": "Reward that it learns from",
    "actor": "Actor",
    "critic": "Critic",
}
CHART_POINTS = 400  # of a prediction; more are not seen
SMALL, TALL = 130.0, 260.0  # heights of one of many charts, and of one that stands alone


def success(groups: Groups) -> Figure | None:
    """Draw success in the rollouts over training: a hue per group, its mean with intervals, each of its seeds thin.

    The interval resamples training seeds, then episodes; with one seed it is Wilson's.
    """
    each = {run: [(r.step, r.rate) for r in run.rollouts] for run in _all(groups) if run.rollouts}
    note = "Thick: mean over training seeds; thin: each of them. Bars: 95 % intervals, resampling seeds and episodes."
    if len(each) == 1:
        note = _note_of_one(*each)
    return _over_training(SUCCESS_TITLE, groups, each, mean_success, note, percent=True)


def mean_reward(groups: Groups) -> Figure | None:
    """Draw the mean reward of rollouts, as :func:`success` does success; with one seed there is no interval."""
    each = {run: run.rewards for run in _all(groups) if run.rewards}
    note = "What a control step was paid, on average."
    if len(each) > 1:
        note += " Thick: mean over training seeds; thin: each of them. "
        note += "Bars: 95 % intervals, resampling seeds; too narrow for few of them."
    return _over_training(REWARD_TITLE, groups, each, mean_rewards, note)


def _note_of_one(run: TrainingRun) -> str:
    last, word = run.rollouts[-1], run.unit.split()[-1]
    best = max(run.rollouts, key=lambda r: (r.rate, r.step))
    note = f"Bars: 95 % Wilson intervals, {last.episodes} episodes each. "
    note += f"Best {_percent(best.rate)} at {word} {best.step}, final {_percent(last.rate)}. "
    return note + "The best of several flatters the policy: evaluate the final one."


def _over_training(
    title: str,
    groups: Groups,
    each: Each,
    mean: Callable[[Sequence[TrainingRun]], list[Mean]],
    note: str,
    *,
    percent: bool = False,
) -> Figure | None:
    """Draw each run thin and each group's mean thick, with its intervals, in the hue that its place among all has.

    Args:
        title: of the figure. groups: label -> runs. each: run -> (step, value), of those that have any.
        mean: runs of a group -> means over its seeds. note: below the figure. percent: values are rates.
    """
    if not each:
        return None
    means = {label: mean([run for run in runs if run in each]) for label, runs in groups.items()}
    written = _percent if percent else tick_label
    ends = ", ".join(f"{label} {written(points[-1][1])}".strip() for label, points in means.items() if points)
    alt = f"{title}{', mean over seeds' if len(each) > 1 else ''}: {ends} at the end"
    values = [value for points in each.values() for _, value in points]
    last = float(max(points[-1][0] for points in each.values()))
    y = (0.0, 1.0) if percent else (min(0.0, *values), max(0.0, *values))
    plot = _wide(last, y, unit_of(each), alt, percent=percent)
    for hue, (label, runs) in enumerate(groups.items()):
        for run in (run for run in runs if run in each and len(runs) > 1):
            steps, seen = zip(*each[run], strict=True)
            plot.line(steps, seen, f"trace thin hue{hue % 8}", title=f"{label}, seed {run.seed}")
        if not means[label]:
            continue
        plot.line([s for s, _, _ in means[label]], [m for _, m, _ in means[label]], f"trace hue{hue % 8}", title=label)
        for step, value, interval in means[label]:
            if interval:
                plot.whisker(step, *interval, f"reach hue{hue % 8}")
            called = f"{label}, " * bool(label) + f"{runs[0].unit.split()[-1]} {step:g}: {written(value)}"
            plot.dot(step, value, f"spot hue{hue % 8}", radius=3.5, title=called)
    return Figure(title, plot.svg(), note)


def _wide(
    last_step: float, y: tuple[float, float], unit: str, alt: str, *, percent: bool = False, log_y: bool = False
) -> Plot:
    """Return the axes of a chart over training that stands alone."""
    x, width = (0.0, last_step), 2 * WIDE
    return Plot(
        x=x, y=y, x_label=unit, y_label="", alt=alt, width=width, height=TALL, percent=percent, log_y=log_y
    )  # fmt: skip


def unit_of(runs: Iterable[TrainingRun]) -> str:
    """Return what the steps of all ``runs`` count; "environment step or round" where they differ in it."""
    return " or ".join(sorted({run.unit for run in runs}))


def losses(runs: Groups) -> Figure | None:
    """Draw the losses over training: of one run its own and that on held-out demonstrations, else a hue per group."""
    lines: list[tuple[str, str, Curve]] = []
    for hue, (label, members) in enumerate(runs.items()):
        for run in members:
            logged_curves = {curve.name: curve for curve in curves_of(run.rows)}
            for k, name in enumerate(LOSSES if len(runs) == 1 else LOSSES[:1]):
                if name in logged_curves:
                    lines.append((f"trace hue{(hue + k) % 8}", f"{label}: {name}", logged_curves[name]))
    if not lines:
        return None
    every = np.concatenate([curve.values for _, _, curve in lines])
    low, high = float(every.min()), float(every.max())
    last = max(float(curve.steps[-1]) for _, _, curve in lines)
    log = low > 0 and high > 5 * low
    said = "; ".join(f"{title} ends at {tick_label(float(curve.values[-1]))}" for _, title, curve in lines)
    label = unit_of(run for run in _all(runs) if run.rows)
    bounds = (low, high) if log else (min(low, 0.0), max(high, 0.0))
    plot = _wide(last, bounds, label, said, log_y=log)
    for kind, title, curve in lines:
        plot.line(curve.steps, curve.values, kind, title=title)
    return Figure("Loss", plot.svg(), "Which of two policies flies better, no loss shows: only rollouts do.")


def others(run: TrainingRun) -> dict[str, list[Figure]]:
    """Draw what else was logged, whatever the algorithm, in small charts under a heading per prefix of the names.

    What other sections show is left out, and the clock.
    """
    groups: dict[str, list[Figure]] = {heading: [] for heading in HEADINGS.values()}
    for curve in curves_of(run.rows):
        prefix, _, name = curve.name.rpartition("/")
        if curve.name not in SHOWN and not prefix.startswith("validation"):
            heading = HEADINGS.get(prefix, prefix.replace("/", ", ").capitalize())
            groups.setdefault(heading, []).append(logged(curve, run.unit, title=spelt(name), height=SMALL))
    return {heading: figures for heading, figures in groups.items() if figures}


def validation(run: TrainingRun) -> list[Figure]:
    """Draw the error on held-out demonstrations, element by element of the action, over training."""
    curves = [c for c in curves_of(run.rows) if c.name.startswith("validation/") and c.name != LOSSES[1]]
    return [logged(curve, run.unit, title=curve.name.removeprefix("validation/"), height=SMALL) for curve in curves]


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


def rewarded(uid: str, lines: Mapping[str, np.ndarray]) -> Figure:
    """Draw a learned reward along the demonstration ``uid``, a line (T,) for each way in which it was flown."""
    every = np.concatenate(list(lines.values()))
    said = ", ".join(f"{label} {tick_label(float(values.mean()))}" for label, values in lines.items())
    last, y = float(max(map(len, lines.values())) - 1), (float(every.min()), float(every.max()))
    plot = _wide(last, y, "control step", f"Learned reward along {uid}; mean {said}")
    for hue, (label, values) in enumerate(lines.items()):
        plot.line(np.arange(len(values)), values, f"trace hue{hue % 8}", title=label)
    return Figure(uid, plot.svg(), f"Mean: {said}.")


def success_along(axis: str, runs: Sequence[TrainingRun]) -> Figure | None:
    """Draw the success in the last rollouts along a setting in which ``runs`` differ: each run, and means.

    Values stand in their order at equal distances; None where no run was flown.
    """
    values = axes_of(runs)[axis]
    ends = [[run.rollouts[-1].rate for run in runs if run.rollouts and settings_of(run).get(axis) == v] for v in values]
    if not any(ends):
        return None
    means = [(k, float(np.mean(rates))) for k, rates in enumerate(ends, start=1) if rates]
    ends_by_value = ", ".join(f"{values[k - 1]} {100 * mean:.0f} %" for k, mean in means)
    alt, x = f"Success at the end by {axis}: {ends_by_value}", (0.5, len(values) + 0.5)
    places = [float(k) for k in range(1, len(values) + 1)]
    plot = Plot(
        x=x, y=(0.0, 1.0), x_label="", y_label="", alt=alt, width=NARROW, height=HEIGHT, percent=True, x_ticks=places
    )
    for place, (value, rates) in enumerate(zip(values, ends, strict=True), start=1):
        for rate in rates:
            plot.dot(place, rate, "knot", radius=2.5, title=f"{axis}={value}: {100 * rate:.0f} %")
    plot.line([place for place, _ in means], [mean for _, mean in means], "curve", title="mean")
    return Figure(axis, plot.svg(), "; ".join(f"{k}: {values[k - 1]}, mean {100 * mean:.0f} %" for k, mean in means))


def _percent(rate: float) -> str:
    """Return a rate in whole percent, but 0 and 100 only where they are exact."""
    whole = f"{100 * rate:.0f}"
    return f"{100 * rate:.1f} %" if whole in ("0", "100") and 0 < rate < 1 else f"{whole} %"


def _all(groups: Groups) -> list[TrainingRun]:
    return [run for runs in groups.values() for run in runs]


def mean_success(runs: Sequence[TrainingRun]) -> list[Mean]:
    """Return the mean success with its 95 % interval at every step at which all of ``runs`` were evaluated."""
    by_step = [{r.step: r for r in run.rollouts} for run in runs]
    means: list[Mean] = []
    for step in _common(by_step):
        points = [one[step] for one in by_step]
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


def mean_rewards(runs: Sequence[TrainingRun]) -> list[Mean]:
    """Return the mean reward at every step at which all of ``runs`` were evaluated; of one run, without interval."""
    by_step = [dict(run.rewards) for run in runs]
    means: list[Mean] = []
    for step in _common(by_step):
        values = np.array([one[step] for one in by_step])
        rng = named_rng(0, "evaluation", "reward over training", str(step))
        interval = statistics.bootstrap_mean(values, rng=rng) if len(runs) > 1 else None
        means.append((float(step), float(values.mean()), interval))
    return means


def _common(by_step: Sequence[Mapping[int, object]]) -> list[int]:
    return sorted(set.intersection(*(set(one) for one in by_step))) if by_step else []
