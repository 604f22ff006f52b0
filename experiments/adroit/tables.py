"""Tables and targets of the Adroit study: success, scores and labels of each arm, beside the published numbers."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.seeding import named_rng
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import bootstrap_mean, newcombe, t_interval, wilson
from experiments.adroit.tasks import TASKS, AdroitTask
from experiments.common.report import Row, Target
from experiments.common.stages import own_time_s, spent_s, steps_of
from experiments.common.success import interval_ends, success_target

MANY = 100
SCORES = {"door": 103.0, "relocate": 88.0}  # of cloning from 100 demonstrations
FEW_SUCCESS_PERCENT = 62.0  # 31 of 50: a perceptron on 25 demonstrations of relocate
HORIZON = 200  # steps of every episode
CHUNKED = ("act", "diffusion", "flow")
CLONED, OWN_RETURNS = "bc", "own_returns.json"
AS = "bc_as_"  # and the name of an interactive algorithm: cloning with as many optimisation steps as that
DAGGER, THRIFTY = "dagger", "thrifty"
AS_GOOD_POINTS = -5.0  # the most that a difference in success may be worth, at the lower end of its interval


@dataclass(frozen=True, order=True)
class Point:
    """One training.

    Attributes:
        task: its name. demos: flights of the expert, or labelled by it. clean: whether it flies without noise.
        policy: class of the learner. seed: of the training. method: ``bc``, or the name of an interactive algorithm.
    """

    task: str
    demos: int
    clean: bool
    policy: str
    seed: int
    method: str = CLONED

    @property
    def arm(self) -> tuple[str, int, bool, str, str]:
        """Everything but the seed."""
        return self.task, self.demos, self.clean, self.policy, self.method

    @property
    def place(self) -> Path:
        """Where its results lie below the folder of the benchmark."""
        source = "clean" if self.clean else "noisy"
        learner = self.policy if self.method == CLONED else f"{self.policy}-{self.method}"
        return Path(self.task) / source / str(self.demos) / learner / str(self.seed)


@dataclass(frozen=True, eq=False)
class Flown:
    """An evaluation, where it lies, and the run of its training, None of an expert."""

    result: EvaluationResult
    judged: Path
    run: Path | None

    @property
    def own_returns(self) -> list[float]:
        """The return of each episode by the environment's own reward."""
        return list(json.loads((self.judged / OWN_RETURNS).read_text()).values())

    def scores(self, task: AdroitTask) -> np.ndarray:
        """(episodes,) normalised scores."""
        return task.score(np.array([episode.return_ for episode in self.result.episodes]))


def _numbers(task: str, found: Sequence[Flown]) -> Row:
    """Return success, score and returns of the trainings of an arm, with intervals over flights and over trainings."""
    solved = [[episode.success for episode in one.result.episodes] for one in found]
    count, flights = sum(map(sum, solved)), sum(map(len, solved))
    returns = np.array([episode.return_ for one in found for episode in one.result.episodes])
    scores = np.array([one.scores(TASKS[task]) for one in found])
    success, score = wilson(count, flights), bootstrap_mean(scores.ravel(), rng=named_rng(0, "adroit score"))
    return {
        "success": count, "episodes": flights, "percent": round(100 * count / flights, 1),
        **interval_ends("ci95", success, scale=100),
        **interval_ends("trainings", t_interval(np.mean(solved, axis=1)), scale=100),
        "score": round(float(scores.mean()), 1), **interval_ends("score", score),
        **interval_ends("score_trainings", t_interval(scores.mean(axis=1))), "return": round(float(returns.mean()), 1),
        "own_return": round(float(np.mean([value for one in found for value in one.own_returns])), 1),
    }  # fmt: skip


def expert_row(task: str, found: Flown) -> Row:
    head = {"task": task, "policy": "expert, mean", "demos": None, "noise_free": None, "seeds": None}
    return {**head, **_numbers(task, [found]), "labelled_steps": None, "queries": None}


def arm_row(found: Mapping[Point, Flown]) -> Row:
    any_of = next(iter(found))
    head = {"task": any_of.task, "policy": any_of.place.parts[3], "demos": any_of.demos, "noise_free": any_of.clean}
    rows = [_row(point, one) for point, one in found.items()]
    means = {name: round(float(np.mean([row[name] for row in rows]))) for name in rows[0]}
    return {**head, "seeds": len(found), **_numbers(any_of.task, list(found.values())), **means}


def _row(point: Point, found: Flown) -> dict[str, float]:
    """Return for how many steps the learner was rows what the expert does, and for how many of them it asked."""
    assert found.run is not None
    last = read_metrics(found.run)[-1]
    if "total/queries" not in last:
        return {"labelled_steps": point.demos * HORIZON, "queries": 0}
    return {name: last[f"total/{name}"] for name in ("labelled_steps", "queries")}


def single_row(point: Point, found: Flown, learner: Any) -> Row:
    assert found.run is not None
    seconds = own_time_s(found.run)
    training = {"train_steps": steps_of(learner), "train_min": round(seconds / 60, 2) if seconds else None}
    return {**asdict(point), **_numbers(point.task, [found]), **training}


def cloning_targets(rows: list[Row]) -> Iterator[Target]:
    """Yield what was asked for, of the arms that were measured."""
    for row in rows:
        if row["demos"] == MANY and row["policy"] == "mlp":
            spread = (
                f"95 % interval {row['score_low']} to {row['score_high']}, {row['success']}/{row['episodes']} solved"
            )
            what = f"{row['task']}, {MANY} demonstrations: normalised score"
            yield Target(what, "at least", SCORES[row["task"]], row["score"], "", spread)
    few = [r for r in rows if r["task"] == "relocate" and r["demos"] == 25 and r["policy"] in CHUNKED]
    if few:
        best = max(few, key=lambda row: row["percent"])
        spread = f"{best['policy']}, 95 % interval {best['ci95_low']} to {best['ci95_high']} %"
        what = "relocate, 25 demonstrations: best chunked class"
        yield Target(what, "at least", FEW_SUCCESS_PERCENT, best["percent"], "%", spread)


def interactive_targets(rows: list[Row]) -> Iterator[Target]:
    """Yield what asking the expert must bring against cloning as many of its flights with as many steps."""
    arms = {(row["policy"], row["demos"]): row for row in rows if row["noise_free"]}
    cloned, taught = arms.get((f"mlp-{AS}{DAGGER}", 15)), arms.get((f"mlp-{DAGGER}", 15))
    if cloned and taught:
        what = "relocate, 15 noise-free flights: lower end of DAgger's interval, above the upper end of cloning's"
        spread = f"{taught['percent']} % against {cloned['percent']} %, both with as many optimisation steps"
        yield Target(what, "at least", cloned["ci95_high"], taught["ci95_low"], "%", spread)
    if row := arms.get((f"mlp-{DAGGER}", 30)):
        yield success_target("relocate, 30 noise-free flights: DAgger", 95.0, row)
        yield from thrift_targets(row, [found for (policy, _), found in arms.items() if policy == f"mlp-{THRIFTY}"])


def thrift_targets(taught: Row, thrifty: list[Row]) -> Iterator[Target]:
    """Yield what ThriftyDAgger, with the most flights that it was given, must save and keep against DAgger."""
    if not thrifty:
        return
    row = max(thrifty, key=lambda found: found["demos"])
    names = f"relocate, ThriftyDAgger with {row['demos']} flights, DAgger with {taught['demos']}"
    labels = f"{row['labelled_steps'] / taught['labelled_steps']:.2f} of its labels, with the first demonstrations"
    share = row["queries"] / taught["queries"]
    yield Target(f"{names}: share of its queries", "at most", 0.5, share, "", labels)
    low, high = newcombe(taught["success"], taught["episodes"], row["success"], row["episodes"])
    spread = f"{row['percent']} % against {taught['percent']} %, difference {100 * low:+.1f} to {100 * high:+.1f}"
    what = f"{names}: lower end of the difference in success"
    yield Target(what, "at least", AS_GOOD_POINTS, round(100 * low, 1), "points", spread)
    spread = f"{row['score_low']} to {row['score_high']} against {taught['score_low']} to {taught['score_high']}"
    yield Target(f"{names}: normalised score", "at least", taught["score_low"], row["score"], "", spread)


def lines(rows: list[Row]) -> list[Row]:
    """Return the learners' rows as the figure wants them: a panel per task, a line per class."""
    return [
        {**row, "robot": f"{row['policy']}{', noise-free' * row['noise_free']}"}
        for row in rows
        if row["demos"] is not None
    ]


def total_seconds(evaluations: Iterable[EvaluationResult], trained: Iterable[Flown]) -> float:
    """Return how long training and judging took, whenever it was done."""
    runs = [one.run for one in trained if one.run is not None]
    return spent_s(runs, evaluations)
