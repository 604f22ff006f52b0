"""Imitation on the robots' tasks: policy classes, from the same draws of demonstrations, on unseen seeds.

Each policy is trained on one draw of demonstrations of one task and robot, flown by the expert in one tier, and its
final checkpoint is judged in every tier asked for. Every stage is kept by all that decides it: killed at any moment,
the same call continues, and an arm that is added flies itself only.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import aerial_il
from aerial_il import robots
from aerial_il.algorithms.bc import BC
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies.act import ACT
from aerial_il.policies.diffusion import Diffusion
from aerial_il.policies.flow import Flow
from aerial_il.policies.gmm import GMM
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.recurrent import Recurrent
from aerial_il.suite import tiers
from experiments.common.demonstrations import NOISE, Source
from experiments.common.figures import learning_lines, method_dots
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.stages import Cloned, Stages
from experiments.common.success import failed_seeds, gain_row, macro_row, pooled_row, pooled_target

DEFAULT, JUDGED_DEMOS = "mlp", 80
LOCAL = MLP(relative=True, masked_fields=("gripper", "wrist_force", "base_pos", "base_rot6d", "joint_*", "ee_*"))
NEWEST: Mapping[str, Any] = {"execute": 10, "ensemble": None}  # half of the newest chunk, not the mean of twenty
POLICIES: Mapping[str, PolicySettings] = {
    DEFAULT: MLP(),
    "mlp_local": LOCAL,
    "mlp_newest": MLP(**NEWEST),
    "recurrent_newest": Recurrent(**NEWEST),
    "flow_newest": Flow(execute=5, ensemble=None),  # a quarter
    **{each.name: each for each in (GMM(), Recurrent(), ACT(), Diffusion(), Flow())},
}
MACRO_PERCENT = {"fa_hexa_arm4": 95.0, "ua_quad_arm4": 92.0, "big_four_z1": 88.0}
HARDEST, HARDEST_PERCENT = "insert_peg", {"fa_hexa_arm4": 90.0, "ua_quad_arm4": 85.0, "big_four_z1": 70.0}
APART_POINTS, APART_TASKS = 15.0, 3
MACRO = "all tasks"
NOTES = (
    "One final checkpoint per training; none is selected by its success. The trainings of an arm differ in their "
    "draw: demonstrations (other seeds), weights and minibatches.",
    "Flights: 95 % interval over the flights of these very policies (Wilson; over all tasks a bootstrap within each "
    "policy). Trainings: Student's 95 % interval with a draw as the unit, over all tasks with its mean over them; it"
    " has no width where all draws have the same success.",
    "Policy class, chunk, optimisation steps and the expert's noise are the defaults of `train` and `collect`, "
    "unless the command above says otherwise.",
    f"Targets are for {JUDGED_DEMOS} demonstrations in the first tier with the default policy class, {DEFAULT}.",
)
OF_APART = (
    "Told apart: the best less the worst of the methods that flew all draws, paired by draw: the same demonstrations "
    "and seeds. Both are chosen by these very flights, which makes the difference larger than it is. Student's 95 % "
    "interval over the draws: p < .05 where it does not hold 0."
)


@dataclass(frozen=True)
class Flight:
    """One evaluation: a policy and the tier that it is flown in."""

    training: Cloned
    tier: str

    @property
    def arm(self) -> Row:
        """The key of a table's row."""
        source = self.training.source
        return {
            "robot": source.robot,
            "method": self.training.method,
            "trained_in": source.tier,
            "flown_in": self.tier,
            "demos": self.training.demos,
            "task": source.task,
        }


Results = Mapping[Flight, EvaluationResult]


@dataclass(frozen=True, kw_only=True)
class Imitation:
    """Settings.

    Attributes:
        policies: name -> what is trained. algorithms: name -> how, of the same names. methods: which of the names;
            empty for all.
        noise: of the expert that demonstrates.
        robots: who flies. tasks: names; empty for all that each does with its end effector.
        demos: demonstrations of a task. sizes: other numbers of them, tried in the first tier only.
        trained_in, flown_in: tiers of demonstrations and of evaluations.
        draws: of demonstrations and weights, one training each; several processes may each take some of them, and a
            last one all.
        episodes: seeds per evaluation. first_episode: the first of them; 5000 to try settings out.
        num_envs: worlds flown at once. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "imitation"
    question: ClassVar[str] = "How well do policies imitate the experts, on every robot and task?"

    policies: Mapping[str, PolicySettings] = field(default_factory=lambda: dict(POLICIES))
    algorithms: Mapping[str, BC] = field(default_factory=lambda: dict.fromkeys(POLICIES, BC()))
    noise: float = NOISE
    methods: tuple[str, ...] = (DEFAULT,)
    robots: tuple[str, ...] = tuple(MACRO_PERCENT)
    tasks: tuple[str, ...] = ()
    demos: int = JUDGED_DEMOS
    sizes: tuple[int, ...] = ()
    trained_in: tuple[str, ...] = ("calm",)
    flown_in: tuple[str, ...] = ("calm", "gusts")
    draws: tuple[int, ...] = (0, 1, 2)
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        if set(self.policies) != set(self.algorithms) or not self.policies:
            raise InvalidValueError(f"policies {list(self.policies)} and algorithms {list(self.algorithms)} differ.")
        for robot in self.robots:
            robots.get(robot)
        able = sorted({task for robot in self.robots for task in able_tasks(robot)})
        for names, valid, what in ((self.methods, self.policies, "method"), (self.tasks, able, "task")):
            for name in names:
                if name not in valid:
                    raise UnknownNameError(what, name, valid)
        for tier in (*self.trained_in, *self.flown_in):
            tiers.get(tier)
        if min(self.demos, self.episodes, *self.sizes) < 1 or not (self.draws and self.trained_in and self.flown_in):
            raise InvalidValueError("demos, sizes and episodes start at 1; draws and tiers must name at least one.")
        check_seeds(self.first_episode, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Collect, train and evaluate what ``folder`` does not hold yet; see :class:`Study`."""
        most = max((self.demos, *self.sizes))
        stages = Stages(
            record=Record(folder), num_envs=self.num_envs, threads=self.threads, progress=progress, most=most
        )
        seeds = range(self.first_episode, self.first_episode + self.episodes)
        flights = list(self.planned_flights())
        results = {f: stages.judged(f.training, f.tier, seeds) for f in bar(flights, self.name, progress)}
        usual = {f: r for f, r in results.items() if f.training.demos == self.demos}
        per_task, macro, scaling = _per_task(usual, stages), macro_rows(usual), self._scaling(results)
        sizes = {"Success over demonstrations": scaling} if self.sizes else {}
        apart = [*told_apart(usual)]
        return Report(
            study=self,
            targets=(*self.targets_of(macro, per_task), *targets_apart(apart)),
            tables={"All tasks": macro, "Each task": per_task, **({"Told apart": apart} if apart else {}), **sizes},
            notes=(*NOTES, *([OF_APART] if apart else []), *stages.record.notes()),
            figures=self.drawn_figures(per_task, scaling),
            details={"failed_seeds": {f"{f.training.label}/{f.tier}": failed_seeds(r) for f, r in results.items()}},
            wall_time_s=stages.seconds(),
        )

    def _cells(self) -> list[tuple[str, str]]:
        return [(robot, task) for robot in self.robots for task in able_tasks(robot) if task in (self.tasks or (task,))]

    def planned_flights(self) -> Iterator[Flight]:
        """Yield what is flown: draw by draw what is judged, then fewer and more demonstrations."""
        methods = self.methods or tuple(self.policies)
        for draw, method, tier, cell in product(self.draws, methods, self.trained_in, self._cells()):
            for flown in self.flown_in:
                yield Flight(self._training(method, cell, tier, self.demos, draw), flown)
        for draw, method, demos, cell in product(self.draws, methods, self._further, self._cells()):
            yield Flight(self._training(method, cell, self.trained_in[0], demos, draw), self.flown_in[0])

    @property
    def _further(self) -> list[int]:
        return sorted(set(self.sizes) - {self.demos})

    def _training(self, method: str, cell: tuple[str, str], tier: str, demos: int, draw: int) -> Cloned:
        source = Source(robot=cell[0], task=cell[1], tier=tier, noise=self.noise, draw=draw)
        return Cloned(method, source, demos, self.policies[method], self.algorithms[method])

    def _scaling(self, results: Results) -> list[Row]:
        """Return success over demonstrations for all tasks and each, in the first tier."""
        tried = {
            f: r
            for f, r in results.items()
            if (f.training.source.tier, f.tier) == (self.trained_in[0], self.flown_in[0])
        }
        rows = [{**arm, "task": MACRO, **_mean(found)} for arm, found in grouped_by(tried, "robot", "method", "demos")]
        rows += [
            {**arm, **pooled_row(found.values())}
            for arm, found in grouped_by(tried, "robot", "method", "demos", "task")
        ]
        kept = ("robot", "method", "task", "demos", "percent")
        ends = [f"{unit}_{end}" for unit in ("flights", "trainings") for end in ("low", "high")]
        return [{key: row[key] for key in (*kept, *ends)} for row in rows]

    def targets_of(self, macro: Sequence[Row], per_task: Sequence[Row]) -> Iterator[Target]:
        """Yield the targets of the default class, of what was flown in full."""
        if self.demos != JUDGED_DEMOS or len(self.draws) < 3:
            return
        for row in filter(self._is_judged, macro):
            if row["robot"] in MACRO_PERCENT and row["tasks"] == len(able_tasks(row["robot"])):
                what = f"{row['robot']}, {self.demos} demonstrations: mean success of all {row['tasks']} tasks"
                yield pooled_target(what, MACRO_PERCENT[row["robot"]], row)
        for row in filter(self._is_judged, per_task):
            if row["task"] == HARDEST and row["robot"] in HARDEST_PERCENT:
                what = f"{row['robot']}, {HARDEST}, {self.demos} demonstrations: success"
                yield pooled_target(what, HARDEST_PERCENT[row["robot"]], row)

    def _is_judged(self, row: Row) -> bool:
        tiers_ = (self.trained_in[0], self.flown_in[0])
        return row["method"] == DEFAULT and (row["trained_in"], row["flown_in"]) == tiers_

    def drawn_figures(self, per_task: Sequence[Row], scaling: Sequence[Row]) -> dict[str, str]:
        dots = [{**row, **_drawn(row), "method": f"{row['robot']}, {row['method']}"} for row in per_task]
        lines = [{**row, **_drawn(row), "robot": f"{row['robot']}, {row['method']}"} for row in scaling]
        return {"tasks.svg": method_dots(dots)} | (
            {"demonstrations.svg": learning_lines(lines, {})} if self.sizes else {}
        )


def able_tasks(robot: str) -> list[str]:
    """Return the tasks that a robot does with its end effector."""
    return [task for flown_by, task in aerial_il.list_cells() if flown_by == robot and task != "hover"]


def grouped_by(results: Results, *names: str) -> Iterator[tuple[Row, Results]]:
    """Group flights by some of their properties, in the order in which they were flown."""
    groups: dict[tuple[Any, ...], dict[Flight, EvaluationResult]] = {}
    for flight, result in results.items():
        groups.setdefault(tuple(flight.arm[name] for name in names), {})[flight] = result
    return ((dict(zip(names, key, strict=True)), found) for key, found in groups.items())


def _per_task(results: Results, stages: Stages) -> list[Row]:
    groups = grouped_by(results, "robot", "method", "trained_in", "flown_in", "demos", "task")
    return [
        {**arm, **pooled_row(found.values()), "train_min": stages.minutes(f.training for f in found)}
        for arm, found in groups
    ]


def told_apart(results: Results) -> Iterator[Row]:
    """Yield, for each cell that several methods flew in the same draws, by how much the best is above the worst."""
    for cell, found in grouped_by(results, "robot", "task", "trained_in", "flown_in"):
        rates: dict[str, dict[int, float]] = {}
        for flight, result in found.items():
            rates.setdefault(flight.training.method, {})[flight.training.source.draw] = result.success["rate"]
        draws = sorted(set[int]().union(*rates.values()))
        whole = {
            method: np.array([each[k] for k in draws]) for method, each in rates.items() if len(each) == len(draws)
        }
        if len(whole) < 2:
            continue
        worst, *_, best = sorted(whole, key=lambda method: whole[method].mean())
        yield {**cell, "best": best, "worst": worst, **gain_row("points", whole[best], whole[worst])}


def targets_apart(apart: Sequence[Row]) -> Iterator[Target]:
    """Yield on how many tasks the methods differ beyond chance, where any differ in three draws."""
    judged = [row for row in apart if row["draws"] >= 3]
    if judged:
        clear = {row["task"] for row in judged if row["points"] >= APART_POINTS and row["low"] > 0}
        what = f"tasks on which the best method is {APART_POINTS:g} points above the worst, p < .05"
        yield Target(what, "at least", APART_TASKS, len(clear), "tasks", ", ".join(sorted(clear)))


def macro_rows(results: Results) -> list[Row]:
    groups = grouped_by(results, "robot", "method", "trained_in", "flown_in", "demos")
    return [{**arm, **_mean(found)} for arm, found in groups]


def _mean(results: Results) -> Row:
    return macro_row({arm["task"]: list(found.values()) for arm, found in grouped_by(results, "task")})


def _drawn(row: Row) -> Row:
    """Return the interval that figures draw: that of the flights."""
    return {"ci95_low": row["flights_low"], "ci95_high": row["flights_high"]}
