"""Returns of imitators as ratios of their experts': rows of a study's tables, and targets."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.seeding import named_rng
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import bootstrap_mean, t_interval, wilson
from experiments.common.report import Row, Target
from experiments.common.success import interval_ends

RATIOS = {"Hopper-v5": 0.95, "HalfCheetah-v5": 0.87}
SUCCESS_PERCENT = {"reach": 90.0}
LIKE, LIKE_WORLDS = "gail_8_worlds", 8
PEER_SPEED = 3.0  # times the environment steps in a minute
FEWEST_TRAININGS, SAME_STEPS = 3, 0.02  # to compare returns; steps end with a whole rollout


def ratio(trainings: Sequence[Sequence[float]], expert: EvaluationResult) -> Row:
    """Return the mean return and its ratio to the expert's, with intervals over flights and over trainings.

    Args:
        trainings: returns of each training's flights. expert: its evaluation on the same seeds.
    """
    flights, best = np.concatenate(trainings), float(np.mean([episode.return_ for episode in expert.episodes]))
    low, high = bootstrap_mean(flights, rng=named_rng(0, "gail ratio"))
    own = [float(np.mean(returns)) / best for returns in trainings]
    return {
        "return": round(float(flights.mean()), 1),
        "ratio": round(float(flights.mean()) / best, 3),
        "ratio_low": round(low / best, 3),
        "ratio_high": round(high / best, 3),
        **interval_ends("trainings", t_interval(np.array(own)), digits=3),
        "each": " ".join(f"{value:.3f}" for value in own),
    }


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
    success_low, success_high = (round(100 * share, 1) for share in wilson(sum(solved), len(solved)))
    trained = [read_metrics(run)[-1] for run in runs]
    return {
        "task": task,
        "method": method,
        "control": control,
        "trainings": len(runs) or None,
        "steps": int(trained[0]["step"]) if trained else None,
        **ratio([[episode.return_ for episode in result.episodes] for result in results], expert),
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
                "method": f"{found['library']}, {found['settings']}, {found['worlds']} worlds, {found['processes']}",
                "control": "none",
                "trainings": len(found["returns"]),
                "steps": found["steps"],
                **ratio(found["returns"], experts[found["task"]]),
                "percent": None,
                "ci95_low": None,
                "ci95_high": None,
                "episodes": sum(map(len, found["returns"])),
                "train_min": round(found["train_s"] / 60, 1),
            }
        )
    return rows


def targets(rows: Sequence[Row], clones: Mapping[str, Row]) -> Iterator[Target]:
    """Yield what was asked for, and at least what a clone reaches alone, of the arms that were measured.

    Args:
        rows: of what is judged. clones: task -> row of the run that reinforcement never moved, where there is one.
    """
    for row in (row for row in rows if row["control"] == "none"):
        task = row["task"]
        alone = clones.get(task, {"ratio": 0.0, "percent": 0.0})
        if task in RATIOS:
            wanted, spread = max(RATIOS[task], alone["ratio"]), f"{row['ratio_low']} to {row['ratio_high']}"
            name, spread = f"ratio to the expert, clone alone {alone['ratio']}", f"{spread}, {row['steps']} steps"
            yield Target(f"{task}: {name}", "at least", wanted, row["ratio"], "", f"95 % interval {spread}")
        if task in SUCCESS_PERCENT:
            wanted, spread = max(SUCCESS_PERCENT[task], alone["percent"]), f"{row['ci95_low']} to {row['ci95_high']} %"
            name = f"success, clone alone {alone['percent']} %"
            yield Target(f"{task}: {name}", "at least", wanted, row["percent"], "%", f"95 % interval {spread}")


def peer_targets(rows: list[Row]) -> Iterator[Target]:
    """Yield what was asked for beside another library's GAIL: like with like in worlds, and each side at its best.

    Returns are compared where both sides have enough trainings, and an equal number of steps.
    """
    for task in dict.fromkeys(row["task"] for row in rows):
        found = [row for row in rows if row["task"] == task and row["control"] == "none"]
        ours = {row["method"]: row for row in found if row["method"] in ("gail", LIKE)}
        peers = [row for row in found if row["method"].startswith("imitation")]
        like = [row for row in peers if f", {LIKE_WORLDS} worlds" in row["method"]]
        if LIKE in ours and like:
            yield from _returns(f"{task}, {LIKE_WORLDS} worlds each", ours[LIKE], _best(like))
            yield from (_speed(task, ours[LIKE], peer) for peer in like)
        if ours and peers:
            yield from _returns(f"{task}, each at its best", _best(list(ours.values())), _best(peers))


def _best(rows: list[Row]) -> Row:
    return max(rows, key=lambda row: row["ratio"])


def _returns(name: str, own: Row, peer: Row) -> Iterator[Target]:
    """Yield that ours be no worse: above theirs, or its interval over trainings reaching theirs."""
    as_long = abs(own["steps"] / peer["steps"] - 1.0) < SAME_STEPS
    if not as_long or min(own["trainings"], peer["trainings"]) < FEWEST_TRAININGS:
        return
    better = own["ratio"] >= peer["ratio"]
    overlap = "disjoint" if own["trainings_low"] > peer["trainings_high"] else "overlapping"
    spread = (
        f"{own['ratio']} ({own['trainings_low']} to {own['trainings_high']}, {own['method']}) against {peer['ratio']} "
        f"({peer['trainings_low']} to {peer['trainings_high']}, {peer['method']}): {overlap if better else 'lower'}"
    )
    what = f"{name}: upper end of our interval over trainings, ratio to the expert, above the lower end of theirs"
    yield Target(what, "at least", peer["trainings_low"], own["trainings_high"], "", spread)


def _speed(task: str, own: Row, peer: Row) -> Target:
    faster = (peer["train_min"] / peer["steps"]) / (own["train_min"] / own["steps"])
    spread = f"{own['train_min']} and {peer['train_min']} min for {own['steps']} and {peer['steps']} steps"
    what = f"{task}, {own['method']} beside {peer['method']}: steps in a minute"
    return Target(what, "at least", PEER_SPEED, round(faster, 2), "times", spread)
