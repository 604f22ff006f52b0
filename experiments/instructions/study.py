"""One policy for many tasks: told by number or in words, beside a policy of its own for each task; and told wrongly.

All arms learn from the same demonstrations of the same tasks. What is told in flight is the task's own instruction, a
wording that nothing learned from, or the instruction of another task. Of the two tasks with one scene, the wrong one is
recognised when it is done: the episode ends as dropped, with the wrong cube in the bowl.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import aerial_il
from aerial_il.algorithms.bc import BC
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.data.joined import Joined
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.language import in_words
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.suite import tasks as registered
from experiments.common.demonstrations import NOISE, Source
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.stages import Cloned, Shown, Stages, described, judged_once, without_cadence
from experiments.common.success import failed_seeds, macro_row, pooled_row

ALONE, NUMBER, WORDS = "alone", "number", "words"
OWN, HELD_OUT, CHINESE, WRONG = "own", "held out", "held out, Chinese", "wrong"
PAIR = {"place_orange": "place_green", "place_green": "place_orange"}  # one scene, two instructions
WITHIN_POINTS, WRONG_PERCENT, RIGHT_PERCENT = 10.0, 80.0, 5.0
MACRO = "all tasks"
NOTES = (
    "One final policy per training, none selected. The trainings of an arm differ in their draw: demonstrations (other "
    "seeds), weights and minibatches.",
    "alone: a policy for each task, of the default settings. number, words: one policy for all tasks, larger and "
    "trained for longer, told by `task_id` or by a hashed bag of words.",
    "told: own, the task's instruction; held out, a wording that nothing learned from; wrong, the instruction of the "
    "other task of one scene, elsewhere that of the next task in the list.",
    "wrong done: share of the flights that ended with the wrong cube let go of in the bowl, the right one never "
    "grasped.",
)


@dataclass(frozen=True, eq=False)
class Together(Shown):
    """One policy for several tasks.

    Attributes:
        source: of the task that is judged. tasks: all that are learned. algorithm: how. words: told in words.
    """

    tasks: tuple[str, ...]
    algorithm: BC
    words: bool

    @property
    def label(self) -> str:
        return f"{self.method}/{self.source.robot}-{len(self.tasks)}-{self.source.tier}/{self.demos}/{self.source.draw}"

    def sources(self) -> list[Source]:
        return [replace(self.source, task=task) for task in self.tasks]

    def decided_by(self) -> dict[str, Any]:
        return {
            "sources": [source.decided_by() for source in self.sources()],
            "demos": self.demos,
            "words": [registered.get(task).wordings for task in self.tasks] if self.words else None,
            **({"understood": "as the nearest of them, shown as the instruction"} if self.words else {}),
            "policy": described(self.policy),
            "algorithm": without_cadence(self.algorithm),
        }

    def train(self, stages: Stages, run: Path) -> Policy:
        shown = [stages.demonstrations(source, self.demos) for source in self.sources()]
        joined = Joined([each.mapped(in_words) for each in shown] if self.words else shown)
        return self.algorithm.train(joined, self.policy, run=run, seed=self.source.draw, progress=stages.progress)


Flown = tuple[Cloned | Together, str]  # a training with the task that it is judged in, and what it is told


@dataclass(frozen=True, kw_only=True)
class Instructions:
    """Settings.

    Attributes:
        alone, alone_trained: policy and training of each task. together, together_trained: of all tasks.
        noise: of the expert that demonstrates. robot: who flies.
        tasks: names; empty for all that the robot does with its end effector. arms: which are flown.
        demos: demonstrations of each task. tier: in which all is flown. draws: of demonstrations and weights.
        episodes: seeds per evaluation. first_episode: the first of them; 5000 to try settings out.
        num_envs: worlds flown at once. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "instructions"
    question: ClassVar[str] = "Does one policy do all tasks, by what it is told?"

    alone: PolicySettings = field(default_factory=MLP)
    alone_trained: BC = field(default_factory=BC)
    together: PolicySettings = field(default_factory=lambda: MLP(hidden=(512, 512)))
    together_trained: BC = field(default_factory=lambda: BC(steps=40_000))
    noise: float = NOISE
    robot: str = "fa_hexa_arm4"
    tasks: tuple[str, ...] = ()
    arms: tuple[str, ...] = (ALONE, NUMBER, WORDS)
    demos: int = 80
    tier: str = "calm"
    draws: tuple[int, ...] = (0, 1, 2)
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        for names, valid, what in ((self.tasks, self.able, "task"), (self.arms, (ALONE, NUMBER, WORDS), "arm")):
            for name in names:
                if name not in valid:
                    raise UnknownNameError(what, name, valid)
        if min(self.demos, self.episodes) < 1 or not (self.draws and self.arms) or len(self.learned) < 2:
            raise InvalidValueError("demos and episodes start at 1; there are draws, arms, and two tasks at least.")
        check_seeds(self.first_episode, self.episodes)

    @property
    def able(self) -> list[str]:
        """Tasks that the robot does with its end effector."""
        return [task for robot, task in aerial_il.list_cells() if robot == self.robot and task != "hover"]

    @property
    def learned(self) -> tuple[str, ...]:
        return self.tasks or tuple(self.able)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Collect, train and evaluate what ``folder`` does not hold yet; see :class:`Study`."""
        stages = Stages(record=Record(folder), num_envs=self.num_envs, threads=self.threads, progress=progress)
        flights = list(self.planned())
        results = {flown: self._judged(stages, flown) for flown in bar(flights, self.name, progress)}
        per_task = [{**arm, **pooled_row(found), **wrongly_done(arm, found)} for arm, found in _grouped(results)]
        macro = list(_macro(results))
        return Report(
            study=self,
            targets=tuple(self.targets_of(macro, per_task)),
            tables={"All tasks": macro, "Each task": per_task},
            notes=(*NOTES, *stages.record.notes()),
            details={
                "failed_seeds": {
                    f"{t.label}/{t.source.task}/{told}": failed_seeds(r) for (t, told), r in results.items()
                }
            },
            wall_time_s=stages.seconds(),
        )

    def planned(self) -> Iterator[Flown]:
        """Yield what is flown, draw by draw."""
        for draw, arm, task in product(self.draws, self.arms, self.learned):
            training = self._training(arm, task, draw)
            for told in (OWN, HELD_OUT, CHINESE, WRONG) if arm == WORDS else (OWN,):
                yield training, told

    def told_in(self, task: str, told: str) -> str:
        """Return the instruction for ``task`` of a kind."""
        order = self.learned
        other = PAIR[task] if PAIR.get(task) in order else order[(order.index(task) + 1) % len(order)]
        meant = registered.get(other if told == WRONG else task)
        return {HELD_OUT: meant.held_out[0], CHINESE: meant.held_out[-1]}.get(told, meant.instruction)

    def _training(self, arm: str, task: str, draw: int) -> Cloned | Together:
        source = Source(robot=self.robot, task=task, tier=self.tier, noise=self.noise, draw=draw)
        if arm == ALONE:
            return Cloned(arm, source, self.demos, self.alone, self.alone_trained)
        return Together(arm, source, self.demos, self.together, self.learned, self.together_trained, words=arm == WORDS)

    def _judged(self, stages: Stages, flown: Flown) -> EvaluationResult:
        training, told = flown
        seeds = range(self.first_episode, self.first_episode + self.episodes)
        if isinstance(training, Cloned):
            return stages.judged(training, self.tier, seeds)
        source, said = training.source, self.told_in(training.source.task, told)
        where = {"tier": self.tier, "seeds": [seeds.start, seeds.stop], "task": source.task, "told": said}
        decided_by = {"training": training.decided_by(), **where}
        stages.run_of(training)
        return judged_once(
            stages.place("evaluations", f"{training.label}/{source.task}/{told}", decided_by),
            lambda: _told(stages.policy(training), said if training.words else None),
            lambda: stages.environment(source, self.tier, min(self.num_envs, len(seeds))),
            seeds,
            name=training.label,
            progress=stages.progress,
        )

    def targets_of(self, macro: Sequence[Row], per_task: Sequence[Row]) -> Iterator[Target]:
        """Yield the targets: as good as policies of their own, and the wrong task where it is told so."""
        by = {(row["arm"], row["told"]): row for row in macro}
        if (ALONE, OWN) in by and (WORDS, OWN) in by:
            for told in (OWN, HELD_OUT, CHINESE):
                less = round(by[ALONE, OWN]["percent"] - by[WORDS, told]["percent"], 1)
                what = f"one policy in words ({told}), mean of all tasks: less than policies of their own by"
                yield Target(what, "at most", WITHIN_POINTS, less, "points")
        for row in per_task:
            if row["told"] == WRONG and row["task"] in PAIR:
                yield Target(f"{row['task']} told wrongly: success", "at most", RIGHT_PERCENT, row["percent"], "%")
                yield Target(
                    f"{row['task']} told wrongly: the wrong task is done", "at least", WRONG_PERCENT,
                    row["wrong_done_percent"], "%",
                )  # fmt: skip


def _told(policy: Policy, said: str | None) -> Policy:
    """Return the policy, told in words what to do."""
    if said is not None:
        assert isinstance(policy, ChunkPolicy)
        policy.told = said
    return policy


def _grouped(results: Mapping[Flown, EvaluationResult]) -> Iterator[tuple[Row, list[EvaluationResult]]]:
    """Group results by arm, what is told and task."""
    groups: dict[tuple[str, str, str], list[EvaluationResult]] = {}
    for (training, told), result in results.items():
        groups.setdefault((training.method, told, training.source.task), []).append(result)
    for (arm, told, task), found in groups.items():
        yield {"arm": arm, "told": told, "task": task}, found


def _macro(results: Mapping[Flown, EvaluationResult]) -> Iterator[Row]:
    """Yield a row for each arm and what it is told: the mean over tasks."""
    arms: dict[tuple[str, str], dict[str, list[EvaluationResult]]] = {}
    for arm, found in _grouped(results):
        arms.setdefault((arm["arm"], arm["told"]), {})[arm["task"]] = found
    for (arm_name, told), tasks in arms.items():
        yield {"arm": arm_name, "told": told, "task": MACRO, **macro_row(tasks)}


def wrongly_done(arm: Row, found: Sequence[EvaluationResult]) -> Row:
    """Return how often the wrong one of two cubes was put into the bowl, the right one never grasped."""
    if arm["task"] not in PAIR:
        return {"wrong_done_percent": None}
    episodes = [episode for result in found for episode in result.episodes]
    wrongly = [e.end == "dropped" and e.subtasks["grasped"] is None for e in episodes]
    return {"wrong_done_percent": round(100 * sum(wrongly) / len(wrongly), 1)}
