"""One HTML file about a training run, or about several that differ in seed or settings; it opens offline."""

import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng
from aerial_il.evaluation import statistics
from aerial_il.evaluation.compare import other_conditions
from aerial_il.evaluation.predictions import Prediction
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.run_collection import axes_of
from aerial_il.evaluation.training_run import BEST, TrainingRun
from aerial_il.presentation.films.video import Footage, embedded
from aerial_il.presentation.pages import run_figures
from aerial_il.presentation.pages.page import END_WORDS, flat, write_page

MOST_SETTINGS = 4  # named in a label
ROLLOUTS = (run_figures.success, run_figures.mean_reward)  # what is drawn of rollouts on the way


def write_run_report(
    path: str | os.PathLike[str],
    run: TrainingRun,
    *,
    predictions: Sequence[Prediction] = (),
    prediction_note: str = "",
    rewarded: Mapping[str, Mapping[str, np.ndarray]] | None = None,
    footage: Footage | None = None,
    flown_by_others: Collection[str] = (),
) -> Path:
    """Write the page of one run.

    Args:
        path: destination, an HTML file.
        run: what is reported.
        predictions: along held-out demonstrations.
        prediction_note: why there are none.
        rewarded: uid of a demonstration -> as what it was flown -> (T,) the learned reward of its steps.
        footage: films of the final policy.
        flown_by_others: evaluations that other weights flew than the run has now.
    """
    films = footage or Footage()
    return write_page(
        path,
        "run.html.j2",
        run=run,
        final=run.rollouts[-1] if run.rollouts else None,
        judged=run.judged,
        flown_by_others=flown_by_others,
        rollouts=[drawn for draw in ROLLOUTS if (drawn := draw({"": [run]}))],
        loss=run_figures.losses({"": [run]}),
        others=run_figures.others(run),
        validation=run_figures.validation(run),
        predictions=[(shown, run_figures.prediction(shown)) for shown in predictions],
        prediction_note=prediction_note,
        rewarded=[run_figures.rewarded(uid, lines) for uid, lines in (rewarded or {}).items()],
        reward_keys=[*enumerate(next(iter((rewarded or {}).values()), {}))],
        clips=embedded(films.clips),
        film_note=films.note,
        end_words=END_WORDS,
        seconds=run.seconds,
        command=run.command.get("command", ""),
        settings=flat(run.config),
        provenance=flat(run.provenance),
    )


def write_runs_report(
    path: str | os.PathLike[str],
    runs: Sequence[TrainingRun],
    *,
    refused: Mapping[Path, str] | None = None,
    chosen: str = "",
) -> Path:
    """Write the page of several runs, grouped by their settings: one group per configuration, its seeds together.

    Args:
        path: destination, an HTML file. runs: what is reported. refused: folders that are no runs -> why.
        chosen: which runs these are of more, in words; empty for all.

    Raises:
        InvalidValueError: two runs are the same one.
    """
    if len({run.path.resolve() for run in runs}) < len(runs):
        raise InvalidValueError("A run is given twice; each seed may count once.")
    runs, again = once(runs)
    groups = grouped(runs)
    return write_page(
        path,
        "runs.html.j2",
        groups=[_group_row(label, hue % 8, members) for hue, (label, members) in enumerate(groups.items())],
        runs=[(label, run) for label, members in groups.items() for run in members],
        rollouts=[drawn for draw in ROLLOUTS if (drawn := draw(groups))],
        loss=run_figures.losses(groups),
        axes=[drawn for axis in axes_of(runs) if (drawn := run_figures.success_along(axis, runs))],
        refused={**(refused or {}), **again},
        chosen=chosen,
    )


def once(runs: Sequence[TrainingRun]) -> tuple[list[TrainingRun], dict[Path, str]]:
    """Return the runs without those that are another one again, and why these are none: a training counts once."""
    first, again = dict[str, TrainingRun](), dict[Path, str]()
    for run in runs:
        known = first.setdefault(repr((dict(run.config), run.setup)), run)
        if known is not run:
            again[run.path] = f"{known.path} again: the same settings, seed and demonstrations"
    return [*first.values()], again


def grouped(runs: Sequence[TrainingRun]) -> dict[str, list[TrainingRun]]:
    """Group runs by all settings but the seed; a group is labelled by the settings in which the groups differ."""
    groups: list[list[TrainingRun]] = []
    for run in runs:
        alike = next((members for members in groups if members[0].setup == run.setup), None)
        groups.append(alike := []) if alike is None else None
        alike.append(run)
    each = [members[0].setup for members in groups]
    keys = sorted({key for settings in each for key in settings})
    differing = [key for key in keys if any(settings.get(key) != each[0].get(key) for settings in each)]
    labels = [_label(settings, differing) or members[0].policy for settings, members in zip(each, groups, strict=True)]
    distinct = labels if len(set(labels)) == len(labels) else [f"{k + 1}: {label}" for k, label in enumerate(labels)]
    return dict(zip(distinct, groups, strict=True))


def _label(settings: Mapping[str, Any], differing: Sequence[str]) -> str:
    if "policy.name" in differing:
        return str(settings.get("policy.name"))
    parts = [f"{key.rpartition('.')[2]}={settings.get(key)}" for key in differing[:MOST_SETTINGS]]
    return ", ".join(parts) + (", ..." if len(differing) > MOST_SETTINGS else "")


def _group_row(label: str, hue: int, runs: Sequence[TrainingRun]) -> dict[str, Any]:
    """Return a group's success: at the end of training, and in each evaluation that all of its runs have."""
    names = set.intersection(*(set(run.judged) for run in runs))
    judged = [row for name in sorted(names) for row in _judged(name, [run.judged[name] for run in runs])]
    ends = run_figures.mean_success(runs)
    end = ends[-1] if ends else None
    return {"label": label, "hue": hue, "runs": runs, "unit": runs[0].unit, "end": end, "judged": judged}


def _judged(name: str, results: Sequence[EvaluationResult]) -> list[tuple[str, dict[str, Any]]]:
    """Return what was measured, and how it came out, of evaluations of one name: apart, where they were flown apart."""
    flown: list[list[EvaluationResult]] = []
    for result in results:
        alike = next((each for each in flown if _flown_alike(each[0], result)), None)
        flown.append(alike := []) if alike is None else None
        alike.append(result)
    said = [f"{name}, {each[0].robot} {each[0].task} {each[0].tier}" for each in flown]
    return [
        (what if said.count(what) == 1 else f"{what} ({number})", _over_seeds(each))
        for number, (what, each) in enumerate(zip(said, flown, strict=True), start=1)
    ]


def _flown_alike(one: EvaluationResult, other: EvaluationResult) -> bool:
    cells = [(each.robot, each.task, each.tier, Path(each.policy).name == BEST) for each in (one, other)]
    return cells[0] == cells[1] and not other_conditions(one, other)


def _over_seeds(results: Sequence[EvaluationResult]) -> dict[str, Any]:
    """Return the mean success of policies of several training seeds with its interval, and that of each."""
    rates = [result.success["rate"] for result in results]
    counted = [len(result.episodes) for result in results]
    episodes = min(counted)
    if len(results) == 1:
        interval = results[0].success["ci95"]
    else:
        counts = [round(rate * episodes) for rate in rates]
        interval = statistics.bootstrap_macro([counts], episodes, rng=named_rng(0, "evaluation", "training seeds"))
    return {"rate": float(np.mean(rates)), "ci95": interval, "rates": rates, "episodes": _span(counted)}


def _span(counts: Sequence[int]) -> str:
    least, most = min(counts), max(counts)
    return str(least) if least == most else f"{least} to {most}"
