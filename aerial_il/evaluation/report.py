"""One HTML file that tells what an evaluation found: nothing in it lies outside it, so it opens offline."""

from __future__ import annotations

import base64
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from aerial_il.core.files import write_atomic
from aerial_il.evaluation import figures
from aerial_il.evaluation.background import DatasetSummary, LearningPoint, training_curves
from aerial_il.evaluation.charts import tick_label
from aerial_il.evaluation.metrics import EpisodeRecord, metrics_of, spread
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.video import Clip, Footage

TEMPLATE = Path(__file__).with_name("report.html.j2")
MOST_FAILURES = 200
END_WORDS = {"success": "success", "crash": "crash", "timeout": "out of time"}


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
    from jinja2 import Environment, StrictUndefined

    page = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    page.filters |= {"number": number, "seconds": seconds, "percent": percent, "words": words}
    curve = sorted(learning_curve, key=lambda p: p.demonstrations)
    html = page.from_string(TEMPLATE.read_text(encoding="utf-8")).render(
        result=result,
        instruction=_instruction(result),
        success=result.success,
        crashes=result.metrics["crash"],
        ends=result.metrics["ends"],
        end_words=END_WORDS,
        rows=_metric_rows(result),
        subtasks=result.metrics["subtasks"],
        distributions=figures.distributions(result),
        paths=figures.paths(result),
        clips=_embedded(footage.clips if footage else ()),
        film_note=footage.note if footage else "",
        failures=_failures(result),
        hidden_failures=max(0, len(result.episodes) - result.success["count"] - MOST_FAILURES),
        training=figures.training(training_curves(run)) if run is not None else [],
        run=str(run or ""),
        dataset=dataset,
        learning_curve=curve,
        learning_figure=figures.learning_curve(curve) if curve else None,
        provenance=list(_flat(result.provenance)),
        command=command,
    )
    return write_atomic(path, html)


def number(value: float | None) -> str:
    """Return three significant digits for people: 1.14, 45.0, 1,234; a dash where there is no number."""
    if value is None:
        return "–"
    if value == 0:
        return "0"
    rounded = float(f"{value:.3g}")
    return f"{value:,.0f}" if abs(rounded) >= 1000 else f"{rounded:#.3g}".removesuffix(".")


def percent(rate: float | None) -> str:
    """Return a rate as a percentage with one decimal, but 0 and 100 only where they are exact."""
    return "–" if rate is None else f"{100 * rate:.1f}" if 0 < rate < 1 else f"{100 * rate:g}"


def seconds(time_s: float | None) -> str:
    """Return a duration: 0.48 s, 12.3 s; a dash where there is none."""
    return "–" if time_s is None else f"{time_s:.1f} s" if time_s >= 10 else f"{time_s:.2f} s"


def words(name: str) -> str:
    """Return a registry name as words: ``pick_place`` -> ``pick place``."""
    return name.replace("_", " ")


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


def _failures(result: EvaluationResult) -> list[dict[str, Any]]:
    failed = [episode for episode in result.episodes if not episode.success][:MOST_FAILURES]
    return [{"episode": episode, "why": END_WORDS[episode.end], "reached": _reached(episode)} for episode in failed]


def _reached(episode: EpisodeRecord) -> str:
    done = [words(name) for name, time_s in episode.subtasks.items() if time_s is not None]
    return ", ".join(done) or "no sub-task"


def _embedded(clips: Sequence[Clip]) -> list[dict[str, Any]]:
    return [{"clip": clip, "episode": clip.episode, "data": _data_uri(clip.path)} for clip in clips]


def _data_uri(path: Path) -> str:
    return "data:video/mp4;base64," + base64.b64encode(path.read_bytes()).decode()


def _flat(tree: Mapping[str, Any], prefix: str = "") -> Sequence[tuple[str, str]]:
    """List nested provenance as (dotted key, text)."""
    rows: list[tuple[str, str]] = []
    for key, value in tree.items():
        if isinstance(value, Mapping):
            rows += _flat(value, f"{prefix}{key}.")
        else:
            rows.append((f"{prefix}{key}", tick_label(value) if isinstance(value, float) else str(value)))
    return rows
