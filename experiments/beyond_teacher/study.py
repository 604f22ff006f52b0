"""Faster than the teacher: reinforcement learning from a clone that is as good, and as slow, as its expert.

A clone of many demonstrations takes the expert's time. It goes on by practice, rewarded for success alone; discounting
makes sooner worth more. Expert, clone and what practice made of it fly the same unseen seeds, and times are compared
seed by seed. Every stage is kept by all that decides it: killed at any moment, the same call continues.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from aerial_il import experts
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.bc_ppo import BCPPO
from aerial_il.core.composition import build, changed
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import Interval
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.suite import tasks
from experiments.common.demonstrations import Source
from experiments.common.notes import demonstrator
from experiments.common.practised import Continued
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.stages import Cloned, Stages, judged_once
from experiments.common.success import failed_seeds, pooled_row

EXPERT, CLONE, ASKED = "expert", "bc", "bc_ppo"
MOST_OF_TIME, MOST_LOST = 75.0, 0.0  # % of the expert's time; points of success
PRECISE: Mapping[str, Any] = {"exploration": {"noise": 0.1, "execute": 5}, "gamma": 0.98}
NEVER = 1_000.0  # %, in place of the time of those that never succeed
RESAMPLES = 2_000  # of the bootstrap
NOTES = (
    "Time: until success. Of the expert's: ratio of the mean times over the seeds that both solved, so that nobody "
    "gains by failing where it takes long. Its 95 % interval is a cluster bootstrap over these seeds, each with the "
    "times of the expert and of all trainings, so that it holds for these very policies.",
    "The reward is sparse, 1 for success, discounted by 1 - gamma in each step; nothing else asks for haste. Judged is "
    "the final policy. Trainings differ in their draw: demonstrations and flights (other seeds), weights and "
    "minibatches. Flights: Wilson's 95 % interval over the flights of these very policies. Trainings: Student's 95 % "
    "interval with a training as the unit.",
)


@dataclass(frozen=True, kw_only=True)
class BeyondTeacher:
    """Settings.

    Attributes:
        policy: what is trained. cloning: how the clone is made. practising: how it goes on. suited: task -> what is
            changed of that there; in insert_peg usual noise lets too few flights succeed.
        robot, tier: what is flown. tasks: which. demos: of the expert, without noise. draws: one training each.
        episodes: unseen seeds that judge.
        first_episode: the first of them. num_envs: worlds flown at once there. threads: of the simulation; 0 for all.
    """

    name: ClassVar[str] = "beyond_teacher"
    question: ClassVar[str] = "Does practice rewarded for success alone make a clone faster than its teacher?"

    policy: PolicySettings = field(default_factory=MLP)
    cloning: BC = field(default_factory=BC)
    practising: BCPPO = build(BCPPO, {"steps": 10_000_000, "lr": 5e-5, "gamma": 0.99, "exploration": {"noise": 0.25}})
    suited: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: {"insert_peg": PRECISE})
    robot: str = "fa_hexa_arm4"
    tier: str = "calm"
    tasks: tuple[str, ...] = ("pick_place", "insert_peg")
    demos: int = 200
    draws: tuple[int, ...] = (0, 1, 2)
    episodes: int = 200
    first_episode: int = EVALUATION_SEED
    num_envs: int = 50
    threads: int = 1

    def __post_init__(self) -> None:
        if min(self.demos, self.episodes, self.num_envs) < 1 or not (self.tasks and self.draws):
            raise InvalidValueError("demos, episodes and num_envs start at 1; tasks and draws name at least one.")
        check_seeds(self.first_episode, self.episodes)
        for task in (*self.tasks, *self.suited):
            tasks.get(task)
        for task in self.suited:
            self._suited(task)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly, train and judge what ``folder`` does not hold yet; see :class:`Study`."""
        stages = Stages(record=Record(folder), num_envs=self.num_envs, threads=self.threads, progress=progress)
        seeds = range(self.first_episode, self.first_episode + self.episodes)
        teachers = {task: self._teacher(task, stages, seeds) for task in self.tasks}
        found: dict[tuple[str, str], list[EvaluationResult]] = {}
        for draw in bar(self.draws, self.name, progress):
            for task in self.tasks:
                for name, training in self.trainings(task, draw).items():
                    found.setdefault((task, name), []).append(stages.judged(training, self.tier, seeds))
        rows = [row for task in self.tasks for row in self.table_rows(task, teachers[task], found, stages)]
        return Report(
            study=self,
            targets=tuple(targets_of(rows)),
            tables={"Time to success": rows},
            notes=(self._flown(), *NOTES, *stages.record.notes()),
            details={
                "failed_seeds": {
                    f"{task}, {name}: {draw}": failed_seeds(result)
                    for (task, name), results in found.items()
                    for draw, result in zip(self.draws, results, strict=True)
                }
            },
            wall_time_s=stages.seconds(),
        )

    def _flown(self) -> str:
        """Return a note that tells what flew, and who demonstrated on it how often."""
        return f"Robot: {demonstrator(self.robot, 0.0)}, each task {self.demos} times in {self.tier}."

    def trainings(self, task: str, draw: int) -> dict[str, Cloned | Continued]:
        """Return the clone and what goes on from it."""
        source = Source(robot=self.robot, task=task, tier=self.tier, draw=draw)
        clone = Cloned(CLONE, source, self.demos, self.policy, self.cloning)
        practising = self._suited(task)
        return {CLONE: clone, ASKED: Continued(ASKED, source, self.demos, self.policy, practising, clone)}

    def _suited(self, task: str) -> BCPPO:
        """Return how practice goes on in a task."""
        return changed(self.practising, self.suited.get(task, {}))

    def _teacher(self, task: str, stages: Stages, seeds: range) -> EvaluationResult:
        """Return how the expert flies the seeds that all are judged on."""
        source = Source(robot=self.robot, task=task, tier=self.tier)
        decided_by = {"expert": True, "seeds": [seeds.start, seeds.stop]}
        place = stages.record.place("evaluations", f"{EXPERT}/{self.robot}-{task}-{self.tier}", decided_by)
        return judged_once(
            place,
            lambda: experts.make(self.robot, task),
            lambda: stages.environment(source, self.tier, min(self.num_envs, len(seeds))),
            seeds,
            name=EXPERT,
            progress=stages.progress,
        )

    def table_rows(
        self,
        task: str,
        teacher: EvaluationResult,
        found: Mapping[tuple[str, str], Sequence[EvaluationResult]],
        stages: Stages,
    ) -> Iterator[Row]:
        """Yield a row for the expert, for its clones and for what became of them."""
        for name in (EXPERT, CLONE, ASKED):
            results = [teacher] if name == EXPERT else found[task, name]
            trained = [] if name == EXPERT else [self.trainings(task, draw)[name] for draw in self.draws]
            practised = [t.flown(stages.run_of(t)) for t in trained if isinstance(t, Continued)]
            yield {
                "task": task,
                "arm": name,
                "demos": 0 if name == EXPERT else self.demos,
                "flown": round(float(np.mean(practised))) if practised else 0,
                "minutes": stages.minutes(trained) if trained else None,
                **pooled_row(results),
                **times_row(results, teacher),
            }


def times_row(results: Sequence[EvaluationResult], teacher: EvaluationResult) -> Row:
    """Return the mean time to success, and its share of the teacher's on the seeds that both solved, in percent."""
    theirs = _solved(teacher)
    pairs = [(seed, s, theirs[seed]) for result in results for seed, s in _solved(result).items() if seed in theirs]
    if not pairs:
        return {"time_s": None, "of_expert": None, "of_expert_low": None, "of_expert_high": None}
    seeds, *times = np.array(pairs).T
    cluster = np.unique(seeds, return_inverse=True)[1]
    ours, expected = (np.bincount(cluster, column) for column in times)
    low, high = _ratio_of_sums(ours, expected)
    return {
        "time_s": round(float(ours.sum()) / len(pairs), 2),
        "of_expert": round(float(100.0 * ours.sum() / expected.sum()), 1),
        "of_expert_low": round(100.0 * low, 1),
        "of_expert_high": round(100.0 * high, 1),
    }


def _solved(result: EvaluationResult) -> dict[int, float]:
    """Return seed -> time to success, s, of the episodes that succeeded."""
    return {e.seed: e.time_to_success_s for e in result.episodes if e.time_to_success_s is not None}


def _ratio_of_sums(ours: np.ndarray, theirs: np.ndarray) -> Interval:
    """Return the 95 % percentile bootstrap interval of the ratio of two sums over the same clusters.

    Args:
        ours, theirs: (N,) what each cluster, here a seed, adds to either sum. Clusters are resampled whole, so that
            both sums vary together and observations within a cluster may depend on each other.

    Source:
        A. C. Davison and D. V. Hinkley, "Bootstrap methods and their application", 1997, section 3.8 (hierarchical
        data).
    """
    rng = named_rng(0, "benchmarks", "beyond_teacher")
    drawn = rng.integers(len(ours), size=(RESAMPLES, len(ours)))
    low, high = np.quantile(ours[drawn].sum(axis=1) / theirs[drawn].sum(axis=1), [0.025, 0.975])
    return Interval(float(low), float(high))


def targets_of(rows: Sequence[Row]) -> Iterator[Target]:
    """Yield what practice must reach: a shorter time, and no success lost for it."""
    experts_percent = {row["task"]: row["percent"] for row in rows if row["arm"] == EXPERT}
    for row in rows:
        if row["arm"] != ASKED:
            continue
        measured, spread = NEVER, "no flight succeeded"
        if row["of_expert"] is not None:
            measured, spread = row["of_expert"], f"{row['of_expert_low']:g} to {row['of_expert_high']:g} %"
        yield Target(f"{row['task']}: time, of the expert's", "at most", MOST_OF_TIME, measured, "%", spread)
        lost = round(experts_percent[row["task"]] - row["percent"], 1)
        flights = f"flights {row['flights_low']:g} to {row['flights_high']:g} %"
        yield Target(f"{row['task']}: success lost", "at most", MOST_LOST, lost, "points", flights)
