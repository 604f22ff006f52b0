"""Standings of methods, from the records of their evaluations alone: robot, task, tier, method, success, cost.

Results that differ in no more than the training's draw are trainings of one method. What was flown with another version
of the engine, or over fewer seeds than the others, stands in no table with the rest; it is named with the reason.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerial_il.core.seeding import named_rng
from aerial_il.evaluation import statistics
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import Interval
from aerial_il.evaluation.training_run import BY_CHANCE, TrainingRun

TRAINED = "trained"  # key of an evaluation's provenance: how the policy came about
FEWEST = 50  # episodes of a result that stands on the board


@dataclass(frozen=True)
class Standing:
    """One method in one cell and tier.

    Attributes:
        robot, task, tier, method: what was flown. trainings, episodes: how many of each. rate: of success.
        ci95: its 95 % interval: Wilson's, over trainings and seeds where there are several trainings of the same seeds.
        demonstrations: that each learned from; None where nothing says so. minutes: mean wall time of the training.
        commands: that fly it again.
    """

    robot: str
    task: str
    tier: str
    method: str
    trainings: int
    episodes: int
    rate: float
    ci95: Interval
    demonstrations: int | None
    minutes: float | None
    commands: tuple[str, ...]


@dataclass(frozen=True)
class Leaderboard:
    """Standings, the best first within each cell and tier, and what is left out.

    Attributes:
        engine: version of the engine that all of it was flown with. standings: in order.
        left_out: place of a result -> why it does not stand here.
    """

    engine: str
    standings: tuple[Standing, ...]
    left_out: Mapping[str, str]

    @property
    def cells(self) -> dict[tuple[str, str], dict[str, list[Standing]]]:
        """(robot, task) -> tier -> standings."""
        found: dict[tuple[str, str], dict[str, list[Standing]]] = {}
        for each in self.standings:
            found.setdefault((each.robot, each.task), {}).setdefault(each.tier, []).append(each)
        return found


def trained(run: TrainingRun) -> dict[str, Any]:
    """Return what a result keeps of how its policy came about: method, settings, demonstrations, wall time."""
    seconds = next((row["elapsed_s"] for row in reversed(run.rows) if "elapsed_s" in row), None)
    dataset = run.config.get("dataset", {})
    return {
        "algorithm": run.algorithm,
        "policy": run.policy,
        "demonstrations": dataset.get("demonstrations") if isinstance(dataset, Mapping) else None,
        "seconds": None if seconds is None else round(float(seconds), 1),
        "settings": {key: value for key, value in run.settings.items() if key not in (*BY_CHANCE, "seed")},
    }


def standings(results: Mapping[str, EvaluationResult], *, fewest: int = FEWEST) -> Leaderboard:
    """Return the standings of results.

    Args:
        results: place -> evaluation. fewest: episodes that a result needs.
    """
    engines = Counter(str(result.provenance.get("engine")) for result in results.values())
    engine = max(engines, key=lambda each: (engines[each], each), default="")
    left_out, groups = dict[str, str](), dict[tuple[str, ...], list[EvaluationResult]]()
    seen: dict[str, str] = {}
    for place, result in results.items():
        reason = _unfit(result, engine, fewest)
        flown = json.dumps([result.tier, result.robot, result.task, result.seeds, _identity(result)], default=str)
        if not reason and flown in seen:
            reason = f"is {seen[flown]} again"
        if reason:
            left_out[place] = reason
            continue
        seen[flown] = place
        groups.setdefault((result.robot, result.task, result.tier, _method(result)), []).append(result)
    found = [_standing(*key, found) for key, found in groups.items()]
    order = sorted(found, key=lambda each: (each.robot, each.task, each.tier, -each.rate, each.method))
    return Leaderboard(engine, tuple(order), left_out)


def _unfit(result: EvaluationResult, engine: str, fewest: int) -> str:
    """Return why a result does not stand on the board; empty if it does."""
    environment = result.provenance.get("environment", {})
    if str(result.provenance.get("engine")) != engine:
        return f"was flown with version {result.provenance.get('engine')} of the engine, the others with {engine}"
    if len(result.episodes) < fewest:
        return f"has {len(result.episodes)} episodes; {fewest} are needed"
    if environment.get("options"):
        return "was flown in an environment from outside"
    if late := environment.get("latency"):
        return f"was flown with latency of its own, {late}"
    return ""


def _identity(result: EvaluationResult) -> str:
    return str(result.provenance.get("policy_sha256") or result.policy)


def _method(result: EvaluationResult) -> str:
    """Return what trainings of one method have in common, for people."""
    how = result.provenance.get(TRAINED)
    if not isinstance(how, Mapping):
        return result.policy
    known = {"bc": ""}.get(str(how.get("algorithm")), f", {how.get('algorithm')}")
    return f"{how.get('policy')}{known}, {how.get('demonstrations') or 'no'} demonstrations"


def _standing(robot: str, task: str, tier: str, method: str, results: Sequence[EvaluationResult]) -> Standing:
    won = [np.array([episode.success for episode in result.episodes], float) for result in results]
    count, total = int(sum(each.sum() for each in won)), sum(each.size for each in won)
    ci95 = statistics.wilson(count, total)
    if len(won) > 1 and len({tuple(result.seeds) for result in results}) == 1:
        resampled = statistics.bootstrap_trainings(np.array(won), rng=named_rng(0, "leaderboard", robot, task, method))
        ci95 = Interval(min(ci95.lo, resampled.lo), max(ci95.hi, resampled.hi))
    how = [result.provenance.get(TRAINED, {}) for result in results]
    seconds = [each["seconds"] for each in how if each.get("seconds") is not None]
    commands = dict.fromkeys(str(result.provenance.get("command", "")) for result in results)
    return Standing(
        robot=robot, task=task, tier=tier, method=method, trainings=len(results), episodes=total, rate=count / total,
        ci95=ci95, demonstrations=how[0].get("demonstrations"),
        minutes=round(sum(seconds) / len(seconds) / 60, 1) if seconds else None,
        commands=tuple(command for command in commands if command),
    )  # fmt: skip
