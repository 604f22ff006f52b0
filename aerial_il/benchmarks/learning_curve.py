"""How a policy grows with its demonstrations: behaviour cloning from few to many, judged on seeds it has never seen.

Demonstrations are collected once per cell; each size takes the first ones of them, so that a larger set contains the
smaller. Every stage leaves its result in the folder of the benchmark: killed at any moment, the same call continues.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import aerial_il
from aerial_il.algorithms.bc import BehaviourCloning
from aerial_il.algorithms.parts.run_folder import read_metrics
from aerial_il.benchmarks.parts.claim import claim
from aerial_il.benchmarks.parts.demonstrations import Source, collections, first, gather, origins
from aerial_il.benchmarks.parts.figures import learning_lines
from aerial_il.benchmarks.parts.progress import bar
from aerial_il.benchmarks.parts.report import Report, Row, Target
from aerial_il.benchmarks.parts.success import failed_seeds, success_row, success_target
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.policy import Policy
from aerial_il.evaluation.result import FILE_NAME, EvaluationResult, load_result
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.policies.mlp import MlpConfig
from aerial_il.policies.parts.network import PolicyConfig

JUDGED_SIZE, LIMITS_PERCENT, LIMIT_MINUTES = 100, {"reach": 99.0, "pick_place": 90.0}, 10.0
EVALUATION_SEED = 10_000
NOTES = (
    "One training run per point, its final policy; the interval is that of the evaluation (Wilson, 95 %) and does not "
    "cover the spread between training seeds.",
    "Each size takes the first demonstrations of one collection, so that larger sets contain the smaller ones.",
    "Training time: wall time of the optimisation steps, the same number for every size.",
)


@dataclass(frozen=True)
class Point:
    """One policy: a cell and a number of demonstrations."""

    robot: str
    task: str
    demos: int

    @property
    def cell(self) -> str:
        return f"{self.robot}-{self.task}"


@dataclass(frozen=True, kw_only=True)
class LearningCurve:
    """Settings.

    Attributes:
        policy: what is trained. algorithm: how. sizes: numbers of demonstrations. robots, tasks: names; empty for all.
        tier: in which demonstrations and evaluations are flown. noise: of the expert while it demonstrates.
        episodes: unseen seeds per evaluation. seed: first of the demonstrations, and seed of the training.
        num_envs: worlds flown at once. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "learning_curve"
    question: ClassVar[str] = "How does the success of behaviour cloning grow with the number of demonstrations?"

    policy: PolicyConfig = field(default_factory=MlpConfig)
    algorithm: BehaviourCloning = field(default_factory=BehaviourCloning)
    sizes: tuple[int, ...] = (10, 25, 50, 100, 200)
    robots: tuple[str, ...] = ()
    tasks: tuple[str, ...] = ()
    tier: str = "calm"
    noise: float = 0.3
    episodes: int = 200
    seed: int = 0
    num_envs: int = 64
    threads: int = 0

    def __post_init__(self) -> None:
        if not self.sizes or min(self.sizes) < 1 or self.episodes < 1:
            raise InvalidValueError(f"sizes and episodes start at 1, got {list(self.sizes)} and {self.episodes}.")
        if self.seed + 2 * max(self.sizes) > EVALUATION_SEED:
            raise InvalidValueError(f"Demonstrations from seed {self.seed} on would run into the seeds of evaluation.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Collect, train and evaluate what ``folder`` does not hold yet; see :class:`Benchmark`."""
        claim(folder, self._plain(), free=("sizes", "robots", "tasks"))
        cells = [c for c in aerial_il.list_cells() if c[0] in (self.robots or c) and c[1] in (self.tasks or c)]
        points = [Point(*cell, demos) for cell in cells for demos in sorted(self.sizes)]
        results = {point: self._result(point, folder, progress) for point in bar(points, self.name, progress)}
        rows = [_row(folder, point, result) for point, result in results.items()]
        return Report(
            name=self.name,
            question=self.question,
            settings=self._plain(),
            targets=tuple(target for row in rows if row["demos"] == JUDGED_SIZE for target in _targets(row)),
            tables={"Success over demonstrations": rows},
            notes=(*NOTES, *_origins(folder, results)),
            figures={"learning_curve.svg": learning_lines(rows, LIMITS_PERCENT)},
            details={"failed_seeds": {f"{p.cell}, {p.demos}": failed_seeds(r) for p, r in results.items()}},
            wall_time_s=_seconds(folder, results),
        )

    def _result(self, point: Point, folder: Path, progress: bool) -> EvaluationResult:
        """Return the evaluation of a point, doing what is left to do for it."""
        judged = folder / "evaluations" / point.cell / str(point.demos)
        if (judged / FILE_NAME).exists():
            return load_result(judged)
        dataset, run = _dataset(folder, point), _training(folder, point)
        source = Source(point.robot, point.task, self.tier, self.noise, self.seed, self.num_envs, self.threads)
        gather(source, dataset, max(self.sizes), progress=progress)
        demonstrations = first(dataset, point.demos)
        policy = self.algorithm.train(demonstrations, self.policy, run=run, seed=self.seed, progress=progress)
        result = self._evaluate(point, policy, progress)
        result.save(judged)
        return result

    def _evaluate(self, point: Point, policy: Policy, progress: bool) -> EvaluationResult:
        name, worlds = f"{self.policy.name}, {point.demos} demonstrations", min(self.num_envs, self.episodes)
        env = aerial_il.load_batch(point.robot, point.task, num_envs=worlds, tier=self.tier, num_threads=self.threads)
        try:
            seeds = range(EVALUATION_SEED, EVALUATION_SEED + self.episodes)
            return evaluate(env, policy, seeds, policy_name=name, progress=progress)
        finally:
            env.close()

    def _plain(self) -> dict[str, Any]:
        """The settings as JSON gives them back."""
        return json.loads(json.dumps({**asdict(self), "policy": {"name": self.policy.name, **self.policy.to_dict()}}))


def _dataset(folder: Path, point: Point) -> Path:
    return folder / "datasets" / point.cell


def _training(folder: Path, point: Point) -> Path:
    return folder / "training" / point.cell / str(point.demos)


def _row(folder: Path, point: Point, result: EvaluationResult) -> Row:
    trained = read_metrics(_training(folder, point))[-1]
    training = {"train_steps": int(trained["step"]), "train_min": round(trained["elapsed_s"] / 60, 2)}
    return {**asdict(point), **success_row(result), **training}


def _seconds(folder: Path, results: Mapping[Point, EvaluationResult]) -> float:
    """Return how long all stages took, whenever they were done."""
    collecting = sum(run["seconds"] for run in collections(_dataset(folder, point) for point in results))
    training = sum(read_metrics(_training(folder, point))[-1]["elapsed_s"] for point in results)
    return collecting + training + sum(result.provenance["wall_time_s"] for result in results.values())


def _origins(folder: Path, results: Mapping[Point, EvaluationResult]) -> list[str]:
    datasets, runs = ([where(folder, point) for point in results] for where in (_dataset, _training))
    return origins(datasets, runs, list(results.values()))


def _targets(row: Row) -> list[Target]:
    what = f"{row['robot']}, {row['task']}, {row['demos']} demonstrations"
    limit = LIMITS_PERCENT.get(row["task"])
    success = [success_target(f"{what}: success", limit, row)] if limit else []
    return [*success, Target(f"{what}: training time", "at most", LIMIT_MINUTES, row["train_min"], "min")]


BENCHMARK = LearningCurve
