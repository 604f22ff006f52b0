"""Reinforcement learning from demonstrations on the Adroit hand, beside cloning them and beside learning without.

DAPG goes on from a clone of few demonstrations, of ``relocate`` by the DAPG expert with the noise it was trained with,
of ``door`` by people. Beside it stand that clone and, as a control, a natural policy gradient from random weights for
as many steps, with settings of its own. Every stage is kept by all that decides it: killed at any moment, the same call
continues.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

from aerial_il.algorithms.dapg import DAPG
from aerial_il.algorithms.npg import NPG
from aerial_il.algorithms.on_policy.from_clone import PRIOR
from aerial_il.algorithms.online.problem import Source as Reward
from aerial_il.core.composition import build
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.files import sha256_of
from aerial_il.data.episode import Episode
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies import load_policy
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from experiments.adroit.people import file_of, flown_by_people
from experiments.adroit.study import Adroit
from experiments.adroit.tables import Point
from experiments.adroit.tasks import POLICIES, TASKS, PublishedRewards
from experiments.common.outside import VERSIONS, Learned, OutsideStages, Task, versions_of
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar, skipped
from experiments.common.seeds import EVALUATION_SEED
from experiments.common.success import failed_seeds, pooled_row, pooled_target

CLONE, ASKED, CONTROL = "clone", "dapg", "npg, no demonstrations"
MOST_WITHOUT = 5.0  # % that the control may solve at the same steps
NOTES = (
    "Success: the goal is held in more than 25 steps of an episode (DAPG), of 200 steps in relocate and 400 in door, "
    "because people took up to 300. Rewards are those of the published returns; sparse: 1 for the step that makes a "
    "success.",
    "relocate: 25 flights of DAPG's expert with the noise it was trained with, other seeds for each draw. door: the "
    "same 25 demonstrations by people in all draws; most of them fail the criterion, "
    "because they end as soon as the door is open.",
    "Clone: what dapg begins with, of the demonstrations alone. npg: a natural policy gradient without demonstrations, "
    "from random weights, for as many steps. It, and what learns from the sparse reward, are trained less "
    "often where there are several draws.",
    "The final policy of each training, on the same fixed seeds. Trainings of an arm differ in their draw. Flights: "
    "Wilson's 95 % interval over the episodes of these very policies. Trainings: Student's 95 % interval with a "
    "training as the unit.",
)


@dataclass(frozen=True)
class Cell:
    """What is shown of a task.

    Attributes:
        task: which. by: who shows it. demos: how many. max_steps: of an episode. wanted: success of dapg, %.
    """

    task: str
    by: Literal["expert", "people"]
    demos: int
    max_steps: int
    wanted: float


CELLS = {cell.task: cell for cell in (Cell("relocate", "expert", 25, 200, 90.0), Cell("door", "people", 25, 400, 80.0))}


@dataclass(frozen=True)
class Arm:
    """What is compared: a task, how it is learned, and from which reward; the clone, of dapg's with that reward."""

    task: str
    name: str
    reward: Reward


FROM_CLONE = build(
    DAPG,
    {
        "steps": 2_000_000, "rollout": {"steps": 20_000}, "step_size": 0.1,
        "exploration": {"execute": 1, "correlation": 0.0, "noise": 0.3},
        "gamma": 0.995, "gae_lambda": 0.97, "demos_weight": 0.01,
        "cloning": {"steps": 4_000, "validation": 0.0, "field_dropout": 0.0},
    },
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class AdroitRl:
    """Settings.

    Attributes:
        data: folder of ``dapg_policies.npz`` and ``door_human_demos.npz``.
        policy: what is cloned and goes on. dapg: how. scratch: what the control trains. npg: how.
        tasks, rewards: which. draws: one training each of dapg with the first reward; others: how many of them train
            the other arms. episodes: that judge one. first_episode: the first of them.
        worlds: that learn. num_envs: worlds flown at once to judge.
    """

    name: ClassVar[str] = "adroit_rl"
    question: ClassVar[str] = "Does reinforcement learning from few demonstrations solve what cloning them does not?"

    data: str = "datasets/adroit"
    policy: PolicySettings = MLP(chunk=1, ensemble=None, hidden=(64, 64), loss="l2", masked_fields=())
    dapg: DAPG = FROM_CLONE
    scratch: SquashedGaussian = SquashedGaussian(hidden=(64, 64), activation="tanh", spread="free")
    npg: NPG = NPG()
    tasks: tuple[str, ...] = ("relocate", "door")
    rewards: tuple[Reward, ...] = ("environment", "sparse")
    draws: tuple[int, ...] = (0, 1, 2)
    others: int = 1
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    worlds: int = 40
    num_envs: int = 25

    def __post_init__(self) -> None:
        for task in self.tasks:
            if task not in CELLS:
                raise UnknownNameError("task of this study", task, CELLS)
        if (
            not (self.tasks and self.rewards and self.draws)
            or min(self.others, self.episodes, self.worlds, self.num_envs) < 1
        ):
            raise InvalidValueError(
                "tasks, rewards and draws name one at least; others, episodes, worlds and num_envs start at 1."
            )

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Record, train and judge what ``folder`` does not hold yet; see :class:`Study`."""
        if not Path(self.data).is_dir():
            what = f"{self.data} does not exist: nothing was measured. Say where the data lie with bench.data=FOLDER."
            return skipped(self, what)
        stages = OutsideStages(
            record=Record(folder),
            episodes=self.episodes,
            first_episode=self.first_episode,
            num_envs=self.num_envs,
            progress=progress,
        )
        work = self.trainings()
        found: dict[Arm, list[EvaluationResult]] = {arm: [] for arm in self.arms()}
        for draw, arm in bar(work, self.name, progress):
            found[arm].append(self._judged(arm, draw, stages))
        rows = {arm: self._row(arm, results, stages) for arm, results in found.items()}
        return Report(
            study=self,
            targets=tuple(targets_of(rows)),
            tables={"Arms": list(rows.values())},
            notes=(*NOTES, self.control_differs()),
            details={
                "failed_seeds": {
                    f"{arm.task}, {arm.reward}, {arm.name}: {draw}": failed_seeds(result)
                    for arm, results in found.items()
                    for draw, result in zip(self.draws_of(arm), results, strict=True)
                }
            },
            wall_time_s=sum(stages.seconds(self.training(arm, d, stages)) for d, arm in work if arm.name != CLONE),
        )

    def arms(self) -> list[Arm]:
        """Return what is compared, task by task."""
        found = []
        for task in self.tasks:
            found.append(Arm(task, CLONE, self.rewards[0]))
            found += [Arm(task, name, reward) for reward in self.rewards for name in (ASKED, CONTROL)]
        return found

    def draws_of(self, arm: Arm) -> tuple[int, ...]:
        """Return the draws of an arm's trainings."""
        asked = arm.name in (CLONE, ASKED) and arm.reward == self.rewards[0]
        return self.draws if asked else self.draws[: self.others]

    def trainings(self) -> list[tuple[int, Arm]]:
        """Return all trainings, the first draw of every arm first."""
        return [(draw, arm) for draw in self.draws for arm in self.arms() if draw in self.draws_of(arm)]

    def training(self, arm: Arm, draw: int, stages: OutsideStages) -> Learned:
        """Return the training of an arm; a clone's is that of dapg, which makes it."""
        cell, adroit_task = CELLS[arm.task], TASKS[arm.task]
        task = Task(arm.task, lambda count: PublishedRewards(adroit_task, count, cell.max_steps), self._ground(cell))
        if arm.name == CONTROL:
            npg = replace(self.npg, reward=arm.reward, steps=self.dapg.steps)
            if arm.reward == "sparse":  # whose silence is what a control is to show
                npg = replace(npg, reward_patience=0)
            return Learned(f"{arm.reward}/{npg.name}", task, npg, self.scratch, draw, self.worlds)
        dapg = replace(self.dapg, reward=arm.reward)
        return Learned(
            f"{arm.reward}/{dapg.name}",
            task,
            dapg,
            self.policy,
            draw,
            self.worlds,
            shown=self._shown_by(cell, draw),
            demos=lambda: self._shown(cell, draw, stages),
        )

    def _ground(self, cell: Cell) -> dict[str, Any]:
        versions = versions_of((*VERSIONS, "gymnasium-robotics"))
        return {"task": cell.task, "max_steps": cell.max_steps, "rewards": "published", **versions}

    def _shown_by(self, cell: Cell, draw: int) -> dict[str, Any]:
        """Return what decides the demonstrations of a draw."""
        if cell.by == "people":  # who flew the same ones for all draws
            draws, file = None, file_of(TASKS[cell.task], Path(self.data))
        else:
            draws, file = draw, Path(self.data) / POLICIES
        return {"by": cell.by, "demos": cell.demos, "draw": draws, "file": sha256_of(file)}

    def _shown(self, cell: Cell, draw: int, stages: OutsideStages) -> Sequence[Episode]:
        """Return the demonstrations, recording the expert's that are missing."""
        if cell.by == "expert":
            point = Point(cell.task, cell.demos, False, "mlp", draw)
            return Adroit(data=self.data).demonstrations(point, cell.demos, stages.record, stages.progress)
        env = PublishedRewards(TASKS[cell.task], 1, cell.max_steps)
        try:
            return flown_by_people(TASKS[cell.task], Path(self.data), env.spec)[: cell.demos]
        finally:
            env.close()

    def _judged(self, arm: Arm, draw: int, stages: OutsideStages) -> EvaluationResult:
        training = self.training(arm, draw, stages)
        if arm.name != CLONE:
            return stages.judged(training)
        seeds = range(self.first_episode, self.first_episode + self.episodes)
        decided_by = {"clone of": training.decided_by(), "seeds": [seeds.start, seeds.stop]}
        place = stages.record.place("evaluations", f"{arm.task}/{CLONE}/{draw}", decided_by)

        def clone() -> Policy:
            stages.judged(training)  # which makes it
            return load_policy(stages.run_of(training) / PRIOR)

        return stages.flown(place, training.task, clone, seeds, name=CLONE)

    def _row(self, arm: Arm, results: Sequence[EvaluationResult], stages: OutsideStages) -> Row:
        cell, learned = CELLS[arm.task], arm.name != CLONE
        trainings = [self.training(arm, draw, stages) for draw in self.draws_of(arm)] if learned else []
        minutes = [stages.seconds(training) / 60 for training in trainings]
        shown = cell.demos if arm.name != CONTROL else 0
        return {
            "task": arm.task,
            "shown_by": cell.by if shown else None,
            "demos": shown,
            "arm": arm.name,
            "reward": arm.reward if learned else None,
            "steps": self.dapg.steps if learned else 0,
            "minutes": round(sum(minutes) / len(minutes), 1) if minutes else None,
            **pooled_row(results),
        }

    def control_differs(self) -> str:
        """Return a note that names all in which the control differs from dapg, besides what is shown."""
        npg, dapg = self.npg, self.dapg
        widths = " and ".join("x".join(map(str, algorithm.critic_hidden)) for algorithm in (npg, dapg))
        return (
            "npg differs from dapg in more than the demonstrations (npg's first): the step size "
            f"({npg.step_size:g} and {dapg.step_size:g}), the critic's minibatches ({npg.rollout.batch_size} and "
            f"{dapg.rollout.batch_size}) and widths ({widths}), the warm-up (none, and {dapg.warmup} steps in which "
            "the clone flies and only the critic learns), and the actor: a squashed Gaussian "
            f"({self.scratch.activation} layers) on observations standardised by their running moments, whose "
            "deviation begins at "
            f"{math.exp(self.scratch.log_std):.2g} of half the range of an action, and the clone's network "
            f"({self.policy.name}) with an unsquashed Gaussian on observations standardised by the demonstrations', "
            f"whose deviation begins at {dapg.exploration.noise:g} of that of the demonstrated actions."
        )


def targets_of(rows: Mapping[Arm, Row]) -> Iterator[Target]:
    """Yield what dapg must reach with the environment's reward, and what the control must not."""
    for arm, row in rows.items():
        if arm.reward == "environment" and arm.name == ASKED:
            yield pooled_target(f"{arm.task}, dense reward: {ASKED}", CELLS[arm.task].wanted, row)
        if arm.reward == "environment" and arm.name == CONTROL:
            what = f"{arm.task}, dense reward: {CONTROL}"
            yield Target(what, "at most", MOST_WITHOUT, row["percent"], "%", f"{row['steps']} steps, as {ASKED}")
