"""Trainings by reward in environments from outside: each done once, judged once, and kept in a study's record."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

import aerial_il
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.contracts import BatchEnv, Policy
from aerial_il.data.episode import Episode
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies.parts.network import PolicySettings
from experiments.common.record import Record
from experiments.common.seeds import EVALUATION_SEED
from experiments.common.stages import described, judged_once, own_time_s, without_cadence

Open = Callable[[int], BatchEnv]
VERSIONS = ("gymnasium", "mujoco")
AVERAGED = 100  # episodes, as Stable-Baselines3 does


@dataclass(frozen=True, eq=False)
class Task:
    """Where it is learned.

    Attributes:
        name: for people. open: makes so many worlds. stands_on: whatever decides how they behave, JSON values.
    """

    name: str
    open: Open
    stands_on: Mapping[str, Any]


def gymnasium_task(name: str, *, packages: Sequence[str] = (), **settings: Any) -> Task:
    """Return a registered environment of Gymnasium; ``packages`` it comes from count beside Gymnasium and MuJoCo."""
    return Task(
        name,
        lambda count: aerial_il.load_gymnasium(name, num_envs=count, **settings),
        {"task": name, "settings": settings, **versions_of((*VERSIONS, *packages))},
    )


def versions_of(packages: Sequence[str]) -> dict[str, str]:
    """Return package -> its installed version."""
    return {package: metadata.version(package) for package in packages}


@dataclass(frozen=True, eq=False)
class Learned:
    """One training.

    Attributes:
        arm: its name, a path. task: where it learns. algorithm: how. policy: what. seed: of all its chance.
        worlds: flown at once. shown: what decides its demonstrations; None where there are none.
        demos: returns them.
    """

    arm: str
    task: Task
    algorithm: Algorithm
    policy: PolicySettings
    seed: int
    worlds: int
    shown: Mapping[str, Any] | None = None
    demos: Callable[[], Sequence[Episode]] = field(default=list[Episode])

    @property
    def label(self) -> str:
        return f"{self.task.name}/{self.arm}/{self.seed}".replace(":", "-")

    def decided_by(self) -> dict[str, Any]:
        """Return all that decides its result."""
        return {
            "algorithm": {"name": self.algorithm.name, **without_cadence(self.algorithm)},
            "policy": described(self.policy),
            "seed": self.seed,
            "worlds": self.worlds,
            "shown": self.shown,
            **self.task.stands_on,
        }


@dataclass(frozen=True, kw_only=True)
class OutsideStages:
    """Does what a record does not hold yet.

    Attributes:
        record: of the study. episodes: flown to judge one.
        first_episode: the first seed of them. num_envs: worlds flown at once there.
        progress: show progress bars.
    """

    record: Record
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    num_envs: int = 25
    progress: bool = True

    def run_of(self, training: Learned) -> Path:
        """Return the folder of a training."""
        return self.record.place("training", training.label, training.decided_by())

    def judged(self, training: Learned) -> EvaluationResult:
        """Return how the final policy of a training does on the seeds that all are judged on."""
        seeds = range(self.first_episode, self.first_episode + self.episodes)
        decided_by = {"training": training.decided_by(), "seeds": [seeds.start, seeds.stop]}
        place = self.record.place("evaluations", training.label, decided_by)
        return self.flown(place, training.task, lambda: self.trained(training), seeds, training.label)

    def flown(self, place: Path, task: Task, policy: Callable[[], Policy], seeds: range, name: str) -> EvaluationResult:
        """Return how ``policy()`` does on ``seeds`` of a task, as ``place`` holds it or flown now."""
        worlds = min(self.num_envs, len(seeds))
        return judged_once(place, policy, lambda: task.open(worlds), seeds, name=name, progress=self.progress)

    def trained(self, training: Learned) -> Policy:
        """Return the final policy of a training."""
        env = training.task.open(training.worlds)
        try:
            return training.algorithm.train(
                training.demos() if training.shown else None,
                training.policy,
                env=env,
                run=self.run_of(training),
                seed=training.seed,
                progress=self.progress,
            )
        finally:
            env.close()

    def seconds(self, training: Learned) -> float:
        """Return the wall time of a training's loop: flying and learning, without evaluations and checkpoints."""
        return own_time_s(self.run_of(training))

    def curve(self, training: Learned) -> list[tuple[float, float, float]]:
        """Return (steps, seconds, mean return of the last hundred episodes) along a training."""
        rows = [row for row in read_metrics(self.run_of(training)) if "episode/return" in row]
        ended = [(row["episode/return"], int(row["episode/count"])) for row in rows]
        return [(row["step"], row["elapsed_s"], mean_of_last(ended[: n + 1])) for n, row in enumerate(rows)]


def mean_of_last(ended: Sequence[tuple[float, int]], most: int = AVERAGED) -> float:
    """Return the mean over the last ``most`` episodes, or all there were, of pairs of a mean and how many it is of."""
    left, total = most, 0.0
    for mean, count in reversed(ended):
        taken = min(left, count)
        left, total = left - taken, total + taken * mean
        if not left:
            break
    return total / (most - left)
