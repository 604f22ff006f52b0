"""Policy classes on human-like demonstrations, beside as many of a script: where several modes must earn their place.

A model of a driver and the scripted expert each demonstrate the same task; every class is cloned from each of them and
flown on the same unseen seeds. The driver's flights are learned from twice: as ``aerial-il train`` does by itself from
a person's, and as they were recorded. Every stage is kept by all that decides it: killed at any moment, the same call
goes on.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

from aerial_il.algorithms.bc import BC
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies.act import ACT
from aerial_il.policies.diffusion import Diffusion
from aerial_il.policies.flow import Flow
from aerial_il.policies.gmm import GMM
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings
from experiments.common.demonstrations import Source
from experiments.common.driver import Driven, suited
from experiments.common.record import Record
from experiments.common.report import Report, Row, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.stages import Cloned, Stages, Training, all_that_decides, check_fewer
from experiments.common.success import failed_seeds, mean_time_s, pooled_row

DRIVER, RECORDED, SCRIPT = "driver", "driver, as recorded", "script"
TEACHERS = (DRIVER, RECORDED, SCRIPT)
NOTES = (
    "Driver: a model with a reaction time of 0.25 s, errors of perception, tremor, pauses and several habits, which "
    "sees the page's numbers and moves sticks; no person has flown. Its flights are learned from as `aerial-il train` "
    "does by itself from a person's (actions are poses that the tool reached later, in its own frame) or, as recorded, "
    "like a script's. Script: the expert, without noise.",
    "The final policy of each training. Trainings of an arm differ in their draw: in demonstrations, weights and "
    "minibatches. Flights: Wilson's 95 % interval over the flights of these very policies. Trainings: Student's 95 % "
    "interval with a training as the unit.",
    "All classes have the same number of optimisation steps and the same chunk; the time limit of a flight is the "
    "task's own. Time: mean to success, of flights that succeed.",
)


def classes() -> dict[str, PolicySettings]:
    """Return the policy classes that are compared, as they come."""
    return {
        "mlp": MLP(), "gmm": GMM(), "act": ACT(), "diffusion": Diffusion(),
        "flow": Flow(),
    }  # fmt: skip


@dataclass(frozen=True, eq=False)
class ClonedDriver:
    """A policy cloned from the driver's demonstrations.

    Attributes:
        source: the cell and the draw. demos: how many. policy: what is trained. algorithm: how.
    """

    source: Source
    demos: int
    policy: PolicySettings
    algorithm: BC

    @property
    def driven(self) -> Driven:
        return Driven(self.source.robot, self.source.task, self.source.tier, self.source.draw)

    @property
    def label(self) -> str:
        return f"{self.policy.name}/driver/{self.driven.label}/{self.demos}"

    def decided_by(self) -> dict[str, Any]:
        return {**all_that_decides(self), "source": self.driven.decided_by()}

    def train(self, stages: Stages, run: Path) -> Policy:
        shown = self.driven.demonstrations(stages.record, self.demos)
        return self.algorithm.train(shown, self.policy, run=run, seed=self.source.draw, progress=stages.progress)


@dataclass(frozen=True, kw_only=True)
class HumanData:
    """Settings.

    Attributes:
        policies: name -> what is trained. arms: which of them; empty for all. algorithm: how.
        robot, task, tier: what is flown. demos: of each teacher. draws: one training of each arm each.
        as_recorded: arms that learn from the driver's flights as they were recorded, too; all but ``act``, whose
            training takes longest.
        fewer: arm -> in how many of the draws it is trained, for classes whose training takes long.
        episodes: unseen seeds per evaluation. first_episode: the first of them. num_envs: worlds flown at once there.
    """

    name: ClassVar[str] = "human_data"
    question: ClassVar[str] = "Which policy classes learn from human-like demonstrations, and which from a script?"

    policies: Mapping[str, PolicySettings] = field(default_factory=classes)
    arms: tuple[str, ...] = ()
    algorithm: BC = field(default_factory=BC)
    robot: str = "fa_hexa_arm4"
    task: str = "pick_place"
    tier: str = "calm"
    demos: int = 100
    draws: tuple[int, ...] = (0, 1, 2)
    as_recorded: tuple[str, ...] = ("mlp", "gmm", "diffusion", "flow")
    fewer: Mapping[str, int] = field(default_factory=dict)
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    num_envs: int = 50

    def __post_init__(self) -> None:
        if min(self.demos, self.episodes, self.num_envs) < 1 or not self.draws:
            raise InvalidValueError("demos, episodes and num_envs start at 1; draws name at least one.")
        for name in (*self.arms, *self.as_recorded):
            if name not in self.policies:
                raise UnknownNameError("arm", name, self.policies)
        check_fewer(self.fewer, self.policies)
        check_seeds(self.first_episode, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Collect, train and judge what ``folder`` does not hold yet; see :class:`Study`."""
        stages = Stages(record=Record(folder), num_envs=self.num_envs, threads=1, progress=progress)
        seeds, arms = range(self.first_episode, self.first_episode + self.episodes), list(self.all_trainings())
        found = [(*arm, stages.judged(arm[2], self.tier, seeds)) for arm in bar(arms, self.name, progress)]
        return Report(
            study=self,
            tables={"Success": list(table_rows(found))},
            notes=(*NOTES, *stages.record.notes()),
            details={"failed_seeds": {f"{teacher}: {t.label}": failed_seeds(r) for _, teacher, t, r in found}},
            wall_time_s=stages.seconds(),
        )

    def all_trainings(self) -> Iterator[tuple[str, str, Training]]:
        """Yield policy class, teacher and training, draw by draw."""
        for draw, name, teacher in product(self.draws, self.arms or tuple(self.policies), TEACHERS):
            wanted = teacher != RECORDED or name in self.as_recorded
            if wanted and draw in self.draws[: self.fewer.get(name)]:
                source = Source(robot=self.robot, task=self.task, tier=self.tier, draw=draw)
                yield name, teacher, self._training(name, teacher, source)

    def _training(self, name: str, teacher: str, source: Source) -> Training:
        policy, algorithm = self.policies[name], self.algorithm
        if teacher == SCRIPT:
            return Cloned(name, source, self.demos, policy, algorithm)
        if teacher == DRIVER:
            algorithm, policy = suited(algorithm, policy)
        return ClonedDriver(source, self.demos, policy, algorithm)


def table_rows(found: list[tuple[str, str, Training, EvaluationResult]]) -> Iterator[Row]:
    """Yield a row for each class and teacher, over all draws."""
    groups: dict[tuple[str, str], list[EvaluationResult]] = {}
    for name, teacher, _, result in found:
        groups.setdefault((name, teacher), []).append(result)
    for (name, teacher), results in groups.items():
        yield {"policy": name, "teacher": teacher, **pooled_row(results), "time_s": mean_time_s(results, digits=1)}
