"""Write one HTML page about an evaluation that opens offline: success, metrics, videos, curves, provenance.

Example: aerial-il report runs/pick_bc/evaluation run=runs/pick_bc dataset=datasets/pick
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from aerial_il.cli.keys import MISSING, MaybeLocated, key, path


@dataclass
class Config:
    result: str = key(MISSING, "folder that holds evaluation.json", position=0)
    run: str | None = key(None, "training run whose curves are shown")
    dataset: MaybeLocated = path(MaybeLocated, "demonstrations to sum up")
    learning_curve: dict[str, str] = key({}, "number of demonstrations -> evaluation: {10:runs/a,25:runs/b}")
    out: str | None = key(None, "the page; report.html beside the evaluation by default")


def run(config: Config) -> None:
    """Write the page and say where."""
    from aerial_il.cli import results
    from aerial_il.evaluation.background import LearningPoint
    from aerial_il.evaluation.report import write_report
    from aerial_il.evaluation.result import load_result

    folder = Path(config.result)
    folder = folder if folder.is_dir() else folder.parent
    result = load_result(config.result)
    page = write_report(
        config.out or folder / "report.html",
        result,
        footage=results.footage_of(folder, result),
        run=config.run,
        dataset=results.summary_of(config.dataset.path) if config.dataset.path else None,
        learning_curve=[LearningPoint(int(n), load_result(place)) for n, place in config.learning_curve.items()],
        command=str(result.provenance.get("command", "")),
    )
    print(f"Report: {page}")
