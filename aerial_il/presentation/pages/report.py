"""One HTML file with the result of an evaluation: nothing in it lies outside it, so it opens offline."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from aerial_il.evaluation.curves import DatasetSummary, LearningPoint, curves_of, read_rows
from aerial_il.evaluation.metrics import EpisodeRecord, metrics_of, spread
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.training_run import METRICS, is_run, read_run
from aerial_il.presentation.films.video import Footage, embedded
from aerial_il.presentation.pages import figures
from aerial_il.presentation.pages.charts import Figure
from aerial_il.presentation.pages.page import END_WORDS, flat, words, write_page

MOST_FAILURES = 200


def write_report(
    path: str | os.PathLike[str],
    result: EvaluationResult,
    *,
    footage: Footage | None = None,
    run: str | os.PathLike[str] | None = None,
    dataset: DatasetSummary | None = None,
    learning_curve: Sequence[LearningPoint] = (),
    command: str = "",
) -> Path:
    """Write the report.

    Args:
        path: destination, an HTML file.
        result: what is reported.
        footage: films of some episodes, embedded.
        run: folder of the training run whose curves are shown.
        dataset: the demonstrations behind the policy.
        learning_curve: evaluations of policies trained on growing numbers of demonstrations.
        command: what a reader types to get this result again.

    Returns:
        The path written.

    Raises:
        InvalidValueError: ``run`` has no readable metrics.
    """
    curve = sorted(learning_curve, key=lambda p: p.demonstrations)
    return write_page(
        path,
        "report.html.j2",
        **_outcome(result),
        **_episodes(result, footage),
        training=_training(run) if run is not None else [],
        run=str(run or ""),
        dataset=dataset,
        learning_curve=curve,
        learning_figure=figures.learning_curve(curve) if curve else None,
        provenance=flat(result.provenance),
        command=command,
    )


def _outcome(result: EvaluationResult) -> dict[str, Any]:
    """What the page says of all episodes together."""
    return {
        "result": result,
        "instruction": _instruction(result),
        "success": result.success,
        "crashes": result.metrics["crash"],
        "dropped": result.metrics["dropped"],
        "ends": result.metrics["ends"],
        "end_words": END_WORDS,
        "rows": _metric_rows(result),
        "subtasks": result.metrics["subtasks"],
        "distributions": figures.distributions(result),
        "paths": figures.paths(result),
    }


def _episodes(result: EvaluationResult, footage: Footage | None) -> dict[str, Any]:
    """What it shows of single episodes: films and failures."""
    clips = footage.clips if footage else ()
    filmed = {clip.episode.seed for clip in clips}
    failures = _failures(result, filmed)
    return {
        "clips": embedded(clips),
        "film_note": footage.note if footage else "",
        "shown": _addresses(failures, filmed),
        "failures": failures,
        "hidden_failures": max(0, len(result.episodes) - result.success["count"] - MOST_FAILURES),
    }


def _training(run: str | os.PathLike[str]) -> list[Figure]:
    curves = curves_of(read_rows(Path(run) / METRICS))
    return figures.training(curves, read_run(run).unit) if is_run(run) else figures.training(curves)


def _instruction(result: EvaluationResult) -> str:
    stated = result.provenance.get("environment", {}).get("instruction", "")
    return stated or f"{words(result.task).capitalize()} on {result.robot}"


def _metric_rows(result: EvaluationResult) -> list[dict[str, Any]]:
    """One row per metric that has values, in the units that people read."""
    rows = []
    for metric in metrics_of(result.episodes):
        label, unit, factor = figures.display(metric)
        values = [metric.value(episode) for episode in result.episodes]
        summary = spread(metric.key, [None if v is None else factor * v for v in values])
        if summary["count"]:
            rows.append({"label": label, "unit": unit, "better": metric.better, **summary})
    return rows


def _failures(result: EvaluationResult, filmed: set[int]) -> list[dict[str, Any]]:
    failed = [episode for episode in result.episodes if not episode.success][:MOST_FAILURES]
    return [{"episode": e, "why": END_WORDS[e.end], "reached": _reached(e), "filmed": e.seed in filmed} for e in failed]


def _addresses(failures: Sequence[dict[str, Any]], filmed: set[int]) -> dict[int, str]:
    """Return seed -> where on the page it is shown: its film, or else its row among the failures."""
    rows = {row["episode"].seed: f"#failure-{row['episode'].seed}" for row in failures}
    return rows | {seed: f"#film-{seed}" for seed in filmed}


def _reached(episode: EpisodeRecord) -> str:
    done = [words(name) for name, time_s in episode.subtasks.items() if time_s is not None]
    return ", ".join(done) or "no sub-task"
