"""Success over the number of demonstrations: behaviour cloning from few to many, judged on seeds it has never seen.

Of each draw of demonstrations, each size takes the first ones, so that a larger set contains the smaller. Every stage
is kept by all that decides it: killed at any moment, the same call continues.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import aerial_il
from aerial_il.algorithms.bc import BC
from aerial_il.benchmarks.parts.records.record import Record
from aerial_il.benchmarks.parts.reporting.figures import learning_lines
from aerial_il.benchmarks.parts.reporting.progress import bar
from aerial_il.benchmarks.parts.reporting.report import Report, Row, Target
from aerial_il.benchmarks.parts.reporting.success import failed_seeds, pooled_row, pooled_target
from aerial_il.benchmarks.parts.training.demonstrations import Source, usual_expert
from aerial_il.benchmarks.parts.training.stages import EVALUATION_SEED, Cloned, Stages, check_seeds, described
from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings

JUDGED_SIZE, LIMITS_PERCENT, LIMIT_MINUTES = 100, {"reach": 99.0, "pick_place": 90.0}, 10.0
NOTES = (
    "One final policy per training; the trainings of a point differ in their draw: demonstrations (other seeds), "
    "weights and minibatches.",
    "Flights: Wilson's 95 % interval over the flights of these very policies. Trainings: Student's 95 % interval "
    "with a training as the unit; it has no width where all have the same success. The figure shows the interval "
    "over flights.",
    "Within a draw, each size takes the first demonstrations, so that larger sets contain the smaller ones.",
    "Training time: wall time of the optimisation steps, whose number is the same for every size.",
)


@dataclass(frozen=True, kw_only=True)
class LearningCurve:
    """Settings.

    Attributes:
        policy: what is trained. algorithm: how. expert: how the expert demonstrates, its ``noise``.
        sizes: numbers of demonstrations. robots, tasks: names; empty for all.
        tier: in which demonstrations and evaluations are flown.
        draws: of demonstrations and weights, one training of each size each.
        episodes: unseen seeds per evaluation. num_envs: worlds flown at once.
        threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "learning_curve"
    question: ClassVar[str] = "How does the success of behaviour cloning grow with the number of demonstrations?"

    policy: PolicySettings = field(default_factory=MLP)
    algorithm: BC = field(default_factory=BC)
    expert: Mapping[str, float] = field(default_factory=usual_expert)
    sizes: tuple[int, ...] = (10, 25, 50, 100, 200)
    robots: tuple[str, ...] = ()
    tasks: tuple[str, ...] = ()
    tier: str = "calm"
    draws: tuple[int, ...] = (0, 1, 2)
    episodes: int = 100
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        if not (self.sizes and self.draws) or min(*self.sizes, self.episodes) < 1:
            raise InvalidValueError(
                f"sizes and episodes start at 1, got {list(self.sizes)} and {self.episodes}; draws name at least one."
            )
        check_seeds(EVALUATION_SEED, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Collect, train and evaluate what ``folder`` does not hold yet; see :class:`Benchmark`."""
        stages = Stages(
            record=Record(folder),
            num_envs=self.num_envs,
            threads=self.threads,
            progress=progress,
            most=max(self.sizes),
        )
        seeds = range(EVALUATION_SEED, EVALUATION_SEED + self.episodes)
        trainings = list(self._trainings())
        results = {t: stages.judged(t, self.tier, seeds) for t in bar(trainings, self.name, progress)}
        rows = list(_rows(results, stages))
        lines = [{**row, "ci95_low": row["flights_low"], "ci95_high": row["flights_high"]} for row in rows]
        return Report(
            name=self.name,
            question=self.question,
            settings=self._plain(),
            targets=tuple(target for row in rows if row["demos"] == JUDGED_SIZE for target in _targets(row)),
            tables={"Success over demonstrations": rows},
            notes=(*NOTES, *stages.origins()),
            figures={"learning_curve.svg": learning_lines(lines, LIMITS_PERCENT)},
            details={"failed_seeds": {training.label: failed_seeds(r) for training, r in results.items()}},
            wall_time_s=stages.seconds(),
        )

    def _trainings(self) -> Iterator[Cloned]:
        """Yield what is trained, draw by draw."""
        cells = [c for c in aerial_il.list_cells() if c[0] in (self.robots or c) and c[1] in (self.tasks or c)]
        for draw, (robot, task), demos in product(self.draws, cells, sorted(self.sizes)):
            source = Source(robot=robot, task=task, tier=self.tier, noise=self.expert["noise"], draw=draw)
            yield Cloned(self.policy.name, source, demos, self.policy, self.algorithm)

    def _plain(self) -> dict[str, Any]:
        """The settings as JSON gives them back."""
        return json.loads(json.dumps({**asdict(self), "policy": described(self.policy)}))


def _rows(results: Mapping[Cloned, EvaluationResult], stages: Stages) -> Iterator[Row]:
    """Yield a row for each cell and size."""
    arms: dict[tuple[str, str, int], list[Cloned]] = {}
    for training in results:
        arms.setdefault((training.source.robot, training.source.task, training.demos), []).append(training)
    for (robot, task, demos), found in sorted(arms.items()):
        head = {"robot": robot, "task": task, "demos": demos}
        cost = {"train_steps": found[0].algorithm.steps, "train_min": stages.minutes(found)}
        yield {**head, **pooled_row(results[training] for training in found), **cost}


def _targets(row: Row) -> Sequence[Target]:
    what = f"{row['robot']}, {row['task']}, {row['demos']} demonstrations"
    limit = LIMITS_PERCENT.get(row["task"])
    success = [pooled_target(f"{what}: success", limit, row)] if limit else []
    return [*success, Target(f"{what}: training time", "at most", LIMIT_MINUTES, row["train_min"], "min")]


BENCHMARK = LearningCurve
