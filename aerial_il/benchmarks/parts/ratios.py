"""How near imitators come to their experts: rows of a study's tables, another library's among them, and targets."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from aerial_il.algorithms.parts.run_folder import read_metrics
from aerial_il.benchmarks.parts.report import Row, Target
from aerial_il.core.seeding import named_rng
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import bootstrap_mean, wilson

RATIOS = {"Hopper-v5": 0.95, "HalfCheetah-v5": 0.87}
SUCCESS_PERCENT = {"reach": 90.0}
PEER_SPEED = 3.0  # times the environment steps in a minute


def ratio(returns: Sequence[float], expert: EvaluationResult) -> Row:
    """Return the mean of ``returns`` and its ratio to the expert's, with a bootstrap's interval."""
    mean, best = float(np.mean(returns)), float(np.mean([episode.return_ for episode in expert.episodes]))
    low, high = bootstrap_mean(np.array(returns), rng=named_rng(0, "gail ratio"))
    found = {"ratio": mean / best, "ratio_low": low / best, "ratio_high": high / best}
    return {"return": round(mean, 1), **{name: round(value, 3) for name, value in found.items()}}


def row(
    task: str,
    method: str,
    control: str,
    results: list[EvaluationResult],
    expert: EvaluationResult,
    runs: list[Path],
) -> Row:
    """Return success, return and ratio to the expert over all episodes of some evaluations."""
    solved = [episode.success for result in results for episode in result.episodes]
    returns = [episode.return_ for result in results for episode in result.episodes]
    success_low, success_high = (round(100 * share, 1) for share in wilson(sum(solved), len(solved)))
    trained = [read_metrics(run)[-1] for run in runs]
    return {
        "task": task,
        "method": method,
        "control": control,
        "seeds": len(runs) or None,
        "steps": int(trained[0]["step"]) if trained else None,
        **ratio(returns, expert),
        "percent": round(100 * float(np.mean(solved)), 1),
        "ci95_low": success_low,
        "ci95_high": success_high,
        "episodes": len(solved),
        "train_min": round(float(np.mean([row["elapsed_s"] for row in trained])) / 60, 1) if trained else None,
    }


def peer_rows(folder: Path, experts: Mapping[str, EvaluationResult]) -> list[Row]:
    """Return what another library reached from the same demonstrations, where it was measured."""
    rows = []
    for file in sorted(folder.glob("*.json")):
        found = json.loads(file.read_text())
        if found["task"] not in experts:
            continue
        rows.append(
            {
                "task": found["task"],
                "method": found["library"],
                "control": "none",
                "seeds": found["seeds"],
                "steps": found["steps"],
                **ratio(found["returns"], experts[found["task"]]),
                "percent": None,
                "ci95_low": None,
                "ci95_high": None,
                "episodes": len(found["returns"]),
                "train_min": round(found["train_s"] / 60, 1),
            }
        )
    return rows


def targets(rows: list[Row]) -> Iterator[Target]:
    """Yield what was asked for, of the arms that were measured."""
    for row in (row for row in rows if row["control"] == "none"):
        if row["task"] in RATIOS:
            spread = f"95 % interval {row['ratio_low']} to {row['ratio_high']}, {row['steps']} steps"
            yield Target(
                f"{row['task']}: ratio to the expert", "at least", RATIOS[row["task"]], row["ratio"], "", spread
            )
        if row["task"] in SUCCESS_PERCENT:
            spread = f"95 % interval {row['ci95_low']} to {row['ci95_high']} %"
            yield Target(
                f"{row['task']}: success", "at least", SUCCESS_PERCENT[row["task"]], row["percent"], "%", spread
            )


def peer_targets(rows: list[Row]) -> Iterator[Target]:
    """Yield what was asked for beside another library's GAIL, where both flew a task."""
    ours = {row["task"]: row for row in rows if (row["method"], row["control"]) == ("gail", "none")}
    for peer in rows:
        if peer["task"] not in ours or not peer["method"].startswith("imitation"):
            continue
        own = ours[peer["task"]]
        faster = (peer["train_min"] / peer["steps"]) / (own["train_min"] / own["steps"])
        spread = (
            f"ratios to the expert {own['ratio']} and {peer['ratio']}, {own['seeds']} and {peer['seeds']} trainings"
        )
        name = f"{peer['task']}, gail beside {peer['method']}"
        yield Target(f"{name}: return", "at least", 1.0, round(own["return"] / peer["return"], 2), "times", spread)
        spread = f"{own['train_min']} and {peer['train_min']} min for {own['steps']} and {peer['steps']} steps"
        yield Target(f"{name}: steps in a minute", "at least", PEER_SPEED, round(faster, 2), "times", spread)
