"""Success over the number of demonstrations: behaviour cloning from few to many, judged on seeds it has never seen.

Of each draw of demonstrations, each size takes the first ones, so that a larger set contains the smaller. Every stage
is kept by all that decides it: killed at any moment, the same call continues.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import ClassVar

import aerial_il
from aerial_il.algorithms.bc import BC
from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings
from experiments.common.demonstrations import NOISE, Source
from experiments.common.figures import learning_lines
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.stages import Cloned, Stages
from experiments.common.success import failed_seeds, pooled_row, pooled_target

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
        policy: what is trained. algorithm: how. noise: of the expert that demonstrates.
        sizes: numbers of demonstrations. robots, tasks: names; empty for all.
        tier: in which demonstrations and evaluations are flown.
        draws: of demonstrations and weights, one training of each size each.
        episodes: unseen seeds per evaluation. first_episode: the first of them. num_envs: worlds flown at once.
        threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "learning_curve"
    question: ClassVar[str] = "How does the success of behaviour cloning grow with the number of demonstrations?"

    policy: PolicySettings = field(default_factory=MLP)
    algorithm: BC = field(default_factory=BC)
    noise: float = NOISE
    sizes: tuple[int, ...] = (10, 25, 50, 100, 200)
    robots: tuple[str, ...] = ("fa_hexa_arm4", "ua_quad_arm4")
    tasks: tuple[str, ...] = ("pick_place", "reach")
    tier: str = "calm"
    draws: tuple[int, ...] = (0, 1, 2)
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        if not (self.sizes and self.draws) or min(*self.sizes, self.episodes) < 1:
            raise InvalidValueError(
                f"sizes and episodes start at 1, got {list(self.sizes)} and {self.episodes}; draws name at least one."
            )
        check_seeds(self.first_episode, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Collect, train and evaluate what ``folder`` does not hold yet; see :class:`Study`."""
        stages = Stages(
            record=Record(folder),
            num_envs=self.num_envs,
            threads=self.threads,
            progress=progress,
            most=max(self.sizes),
        )
        seeds = range(self.first_episode, self.first_episode + self.episodes)
        trainings = list(self.all_trainings())
        results = {t: stages.judged(t, self.tier, seeds) for t in bar(trainings, self.name, progress)}
        rows = list(table_rows(results, stages))
        lines = [{**row, "ci95_low": row["flights_low"], "ci95_high": row["flights_high"]} for row in rows]
        return Report(
            study=self,
            targets=tuple(target for row in rows if row["demos"] == JUDGED_SIZE for target in targets_of(row)),
            tables={"Success over demonstrations": rows},
            notes=(*NOTES, *stages.record.notes()),
            figures={"learning_curve.svg": learning_lines(lines, LIMITS_PERCENT)},
            details={"failed_seeds": {training.label: failed_seeds(r) for training, r in results.items()}},
            wall_time_s=stages.seconds(),
        )

    def all_trainings(self) -> Iterator[Cloned]:
        """Yield what is trained, draw by draw."""
        cells = [c for c in aerial_il.list_cells() if c[0] in (self.robots or c) and c[1] in (self.tasks or c)]
        for draw, (robot, task), demos in product(self.draws, cells, sorted(self.sizes)):
            source = Source(robot=robot, task=task, tier=self.tier, noise=self.noise, draw=draw)
            yield Cloned(self.policy.name, source, demos, self.policy, self.algorithm)


def table_rows(results: Mapping[Cloned, EvaluationResult], stages: Stages) -> Iterator[Row]:
    """Yield a row for each cell and size."""
    arms: dict[tuple[str, str, int], list[Cloned]] = {}
    for training in results:
        arms.setdefault((training.source.robot, training.source.task, training.demos), []).append(training)
    for (robot, task, demos), found in sorted(arms.items()):
        head = {"robot": robot, "task": task, "demos": demos}
        cost = {"train_steps": found[0].algorithm.steps, "train_min": stages.minutes(found)}
        yield {**head, **pooled_row(results[training] for training in found), **cost}


def targets_of(row: Row) -> Sequence[Target]:
    what = f"{row['robot']}, {row['task']}, {row['demos']} demonstrations"
    limit = LIMITS_PERCENT.get(row["task"])
    success = [pooled_target(f"{what}: success", limit, row)] if limit else []
    return [*success, Target(f"{what}: training time", "at most", LIMIT_MINUTES, row["train_min"], "min")]
