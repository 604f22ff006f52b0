"""Hindsight in an environment that is not ours: panda-gym's reach and push, by what learns from a replay buffer.

Both tasks pay -1 for every step that has not reached the goal, and end when it is reached; nothing is demonstrated.
Every training is kept by all that decides it: killed at any moment, the same call continues.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from aerial_il.algorithms.ddpg import DDPG
from aerial_il.algorithms.sac import SAC
from aerial_il.algorithms.td3 import TD3
from aerial_il.core.composition import build
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from experiments.common.outside import Learned, OutsideStages, gymnasium_task
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar, skipped
from experiments.common.seeds import EVALUATION_SEED
from experiments.common.success import failed_seeds, pooled_row

REACH, PUSH = "PandaReach-v3", "PandaPush-v3"
PHYSICS = ("pybullet", "pybullet-arm64")  # under either name
WANTED: Mapping[str, float] = {REACH: 100.0, PUSH: 95.0}  # % of the seeds
WANTED_RETURN = -2.0  # on REACH: steps that had not reached the goal
MISSING = (
    "panda-gym is not installed: nothing was measured. Install it with its physics: python -m pip install --no-deps "
    "panda-gym pybullet-arm64 (which has wheels for all processors; `pybullet` itself has none for Python 3.12)."
)
NOTES = (
    "The reward is sparse: -1 for every step that has not reached the goal; an episode ends when it is reached, or "
    "after 50 steps. Each step is stored with other goals too (hindsight). Nothing is demonstrated.",
    "The final policy of each training, its mean action, on the same held-out seeds. Trainings differ in weights, "
    "exploration and episodes. Flights: Wilson's 95 % interval over the episodes of these very policies. Trainings: "
    "Student's 95 % interval with a training as the unit.",
    "Return: mean over all episodes; in worst_return over those of the worst training. Minutes: of acting and learning "
    "on one core, mean over trainings.",
)


@dataclass(frozen=True)
class Arm:
    """What is compared: a task and what learns it."""

    task: str
    name: str


SHARED: Mapping[str, Any] = {"gamma": 0.95, "lr": 0.001, "lr_floor": 0.05, "hindsight": {"goals": 4}}
ON_REACH: Mapping[str, Any] = {
    **SHARED, "steps": 20_000, "warmup": 1_000, "replay": {"updates_per_step": 1.0},
    "critics": {"tau": 0.02, "hidden": (128, 128)},
    "reward_patience": 0, "cadence": {"checkpoint_every": 5_000, "keep_checkpoints": 1},
}  # fmt: skip
ON_PUSH: Mapping[str, Any] = {
    **SHARED, "steps": 1_000_000, "warmup": 5_000, "replay": {"updates_per_step": 0.25},
    "critics": {"tau": 0.02, "hidden": (256, 256)},
    "reward_patience": 0, "cadence": {"checkpoint_every": 50_000, "keep_checkpoints": 1},
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Panda:
    """Settings.

    Attributes:
        policy: what is trained. reach: the algorithms on ``PandaReach-v3``, by name. push: those on ``PandaPush-v3``.
        seeds: trainings of each arm of reach; pushes: of push, which takes long.
        worlds: that learn on push; on reach it is one. episodes: held-out seeds that judge one training.
        first_episode: the first of them.
    """

    name: ClassVar[str] = "panda"
    question: ClassVar[str] = (
        "Does off-policy learning with hindsight solve panda-gym's tasks, and with which algorithm?"
    )

    policy: SquashedGaussian = SquashedGaussian(hidden=(64, 64))
    reach: Mapping[str, SAC | TD3 | DDPG] = field(
        default_factory=lambda: {kind.name: build(kind, ON_REACH) for kind in (DDPG, TD3, SAC)}
    )
    push: Mapping[str, SAC | TD3 | DDPG] = field(default_factory=lambda: {"sac": build(SAC, ON_PUSH)})
    tasks: tuple[str, ...] = (REACH, PUSH)
    seeds: int = 3
    pushes: int = 1
    worlds: int = 8
    episodes: int = 200
    first_episode: int = EVALUATION_SEED

    def __post_init__(self) -> None:
        for task in self.tasks:
            if task not in WANTED:
                raise UnknownNameError("task of this study", task, WANTED)
        if not self.tasks or min(self.seeds, self.pushes, self.worlds, self.episodes) < 1:
            raise InvalidValueError("tasks name one at least; seeds, pushes, worlds and episodes start at 1.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Train and judge what ``folder`` does not hold yet; see :class:`Study`."""
        if find_spec("panda_gym") is None:
            return skipped(self, MISSING)
        stages = OutsideStages(
            record=Record(folder), episodes=self.episodes, first_episode=self.first_episode, progress=progress
        )
        work = self.trainings()
        found: dict[Arm, list[EvaluationResult]] = {arm: [] for arm, _ in work}
        for arm, seed in bar(work, self.name, progress):
            found[arm].append(stages.judged(self.training(arm, seed)))
        rows = {arm: self._row(arm, results, stages) for arm, results in found.items()}
        return Report(
            study=self,
            targets=tuple(targets_of(rows)),
            tables={"Arms": list(rows.values())},
            notes=NOTES,
            details={
                "failed_seeds": {
                    f"{arm.task}, {arm.name}: {seed}": failed_seeds(result)
                    for arm, results in found.items()
                    for seed, result in enumerate(results)
                }
            },
            wall_time_s=sum(stages.seconds(self.training(arm, seed)) for arm, seed in work),
        )

    def trainings(self) -> list[tuple[Arm, int]]:
        """Return all trainings, the first seed of every arm first."""
        planned = {REACH: (self.reach, self.seeds), PUSH: (self.push, self.pushes)}
        found = [
            (Arm(task, name), seed)
            for task in self.tasks
            for name in planned[task][0]
            for seed in range(planned[task][1])
        ]
        return sorted(found, key=lambda training: training[1])

    def training(self, arm: Arm, seed: int) -> Learned:
        """Return one training of an arm."""
        task = gymnasium_task(f"panda_gym:{arm.task}", packages=("panda-gym", *_installed(PHYSICS)))
        algorithms, worlds = (self.reach, 1) if arm.task == REACH else (self.push, self.worlds)
        return Learned(arm.name, task, algorithms[arm.name], self.policy, seed, worlds)

    def _row(self, arm: Arm, results: list[EvaluationResult], stages: OutsideStages) -> Row:
        minutes = [stages.seconds(self.training(arm, seed)) / 60 for seed in range(len(results))]
        returns = [float(np.mean([episode.return_ for episode in result.episodes])) for result in results]
        return {
            "task": arm.task,
            "arm": arm.name,
            "steps": self.training(arm, 0).algorithm.steps,
            "minutes": round(float(np.mean(minutes)), 1),
            **pooled_row(results),
            "return": round(float(np.mean(returns)), 2),
            "worst_return": round(min(returns), 2),
        }


def _installed(packages: Sequence[str]) -> list[str]:
    """Return which of them are installed."""
    return [package for package in packages if any(metadata.distributions(name=package))]


def targets_of(rows: Mapping[Arm, Row]) -> Iterator[Target]:
    """Yield what each algorithm must reach with the worst of its trainings, and on reach how fast on the whole."""
    for arm, row in rows.items():
        spread = f"{row['success']} of {row['episodes']} in {row['trainings']} trainings"
        yield Target(f"{arm.task}, {arm.name}: worst training", "at least", WANTED[arm.task], row["worst"], "%", spread)
        if arm.task == REACH:
            what, spread = f"{arm.task}, {arm.name}: return", f"worst training {row['worst_return']}"
            yield Target(what, "at least", WANTED_RETURN, row["return"], "", spread)
