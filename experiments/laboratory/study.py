"""The laboratory judged: how often a policy seems to differ from itself, and whether an evaluation comes out again.

One clone is flown over many seeds. Comparisons are made of two sets of its flights that share no seed: whatever is
called a difference is a false alarm. Then an evaluation is flown once more by other numbers of worlds and threads.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from aerial_il.algorithms.bc import BC
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng
from aerial_il.evaluation import statistics
from aerial_il.evaluation.compare import compare
from aerial_il.evaluation.laboratory import compared
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings
from experiments.common.demonstrations import NOISE, Source
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.stages import Cloned, Stages

ALPHA, MOST_PERCENT = 0.05, 7.0
NOTES = (
    "Each comparison draws two sets of flights without a common seed from the pool: the policy is one and the same. "
    "compare: Fisher's exact test. conditions: one of the sets stands for seven conditions beside their twins, of "
    "which none may be called different after Holm's correction; pairs are by order, the seeds differ.",
    "again: flights that are equal in all their numbers when the same seeds are flown by another number of worlds and "
    "threads.",
)


@dataclass(frozen=True, kw_only=True)
class LaboratoryStudy:
    """Settings.

    Attributes:
        policy, algorithm: of the clone. noise: of the expert that demonstrates. robot, task, tier: where it flies; it
            learns in calm air. demos: how many it learns from. draw: of demonstrations and weights.
        pool: flights from which sets are drawn. comparisons: of two sets. episodes: of a set.
        conditions: rows of a table that are corrected together. repeated: flights that are flown once more.
        first_episode: the first seed. num_envs: worlds flown at once. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "laboratory"
    question: ClassVar[str] = "How often does a policy seem to differ from itself, and do flights come out again?"

    policy: PolicySettings = field(default_factory=MLP)
    algorithm: BC = field(default_factory=BC)
    noise: float = NOISE
    robot: str = "ua_quad_arm4"
    task: str = "pick_place"
    tier: str = "gusts"
    demos: int = 80
    draw: int = 0
    pool: int = 8000
    comparisons: int = 200
    episodes: int = 100
    conditions: int = 7
    repeated: int = 100
    first_episode: int = EVALUATION_SEED
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        if self.pool < (1 + self.conditions) * self.episodes or min(self.comparisons, self.repeated) < 1:
            raise InvalidValueError(
                f"pool={self.pool} must hold {1 + self.conditions} sets of episodes={self.episodes}; comparisons and "
                "repeated start at 1."
            )
        check_seeds(self.first_episode, self.pool)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Train and fly what ``folder`` does not hold yet; see :class:`Study`."""
        stages = Stages(record=Record(folder), num_envs=self.num_envs, threads=self.threads, progress=progress)
        source = Source(robot=self.robot, task=self.task, tier="calm", noise=self.noise, draw=self.draw)
        training = Cloned("mlp", source, self.demos, self.policy, self.algorithm)
        seeds = range(self.first_episode, self.first_episode + self.pool)
        flown = stages.judged(training, self.tier, seeds)
        alarms = {"compare": list(self._pairs(flown)), "conditions": list(self._tables(flown))}
        rows = [_alarm_row(kind, found) for kind, found in alarms.items()]
        equal = self._equal(stages, training, flown)
        return Report(
            study=self,
            targets=(
                *(
                    Target(f"{row['kind']}: false alarms", "at most", MOST_PERCENT, row["percent"], "%", _said(row))
                    for row in rows
                ),
                Target("again: flights that are equal", "at least", float(self.repeated), float(equal), ""),
            ),
            tables={
                "False alarms": rows,
                "The pool": [{"flights": self.pool, "percent": round(100 * flown.success["rate"], 1)}],
            },
            notes=(*NOTES, *stages.record.notes()),
            wall_time_s=stages.seconds(),
        )

    def _sets(self, flown: EvaluationResult, number: int, count: int) -> Iterator[EvaluationResult]:
        """Yield sets of flights of the pool that share none, all under the seeds of the first."""
        order = named_rng(number, "laboratory", "sets").permutation(len(flown.episodes))
        for k in range(count):
            chosen = order[k * self.episodes : (k + 1) * self.episodes]
            episodes = [replace(flown.episodes[i], seed=seed) for seed, i in enumerate(chosen.tolist())]
            yield replace(flown, episodes=tuple(episodes), flights={})

    def _pairs(self, flown: EvaluationResult) -> Iterator[bool]:
        """Yield whether each comparison of two sets is a false alarm."""
        for number in range(self.comparisons):
            one, other = self._sets(flown, number, 2)
            moved = replace(other, episodes=tuple(replace(e, seed=e.seed + self.episodes) for e in other.episodes))
            yield compare(one, moved).p_value < ALPHA

    def _tables(self, flown: EvaluationResult) -> Iterator[bool]:
        """Yield whether any row of each table is a false alarm."""
        for number in range(self.comparisons):
            twins, *others = self._sets(flown, self.comparisons + number, 1 + self.conditions)
            table = compared({"mlp": {"twins": [twins], **{str(k): [each] for k, each in enumerate(others)}}}, "twins")
            yield any(row.p_adjusted is not None and row.p_adjusted < ALPHA for row in table.rows)

    def _equal(self, stages: Stages, training: Cloned, flown: EvaluationResult) -> int:
        """Fly the first seeds once more otherwise, and return how many flights are equal in all their numbers."""
        seeds = range(self.first_episode, self.first_episode + self.repeated)
        env = stages.environment(training.source, self.tier, max(1, self.num_envs // 7))
        try:
            again = evaluate(env, stages.policy(training), seeds, policy_name=training.label, progress=stages.progress)
        finally:
            env.close()
        return sum(one == other for one, other in zip(flown.episodes, again.episodes, strict=False))


def _alarm_row(kind: str, found: Sequence[bool]) -> Row:
    low, high = statistics.wilson(sum(found), len(found))
    share = round(100 * float(np.mean(found)), 1)
    return {
        "kind": kind, "comparisons": len(found), "alarms": sum(found), "percent": share,
        "low": round(100 * low, 1), "high": round(100 * high, 1),
    }  # fmt: skip


def _said(row: Row) -> str:
    return f"{row['alarms']} of {row['comparisons']} ({row['low']}-{row['high']} %)"
