"""The worth of an expert's answers: cloning its flights, or asking it while the learner flies, at equal cost.

Every arm begins with the same few demonstrations of its draw. The interactive ones add flights in rounds. Beside each
stand two controls: cloning as many demonstrations as it had episodes in all, with the usual number of optimisation
steps and with as many as it took over all its rounds. The final policies are flown on the same unseen seeds. Every
stage is kept by all that decides it: killed at any moment, the same call continues.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import ClassVar

import numpy as np

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.dagger import DAgger
from aerial_il.algorithms.dart import DART
from aerial_il.algorithms.interactive.gates.thrifty import ThriftyGate
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings
from experiments.common.demonstrations import NOISE, Source
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.stages import Asked, Cloned, Stages
from experiments.common.success import failed_seeds, gain_row, mean_time_s, pooled_row, pooled_target

START, EPISODES, STEPS = "bc, first demonstrations", "bc, as many episodes", "bc, as many episodes and steps"
JUDGED, JUDGED_PERCENT = "dagger", 95.0
NOTES = (
    "Results are those of the final policy of each training. The trainings of an arm differ in their draw: "
    "demonstrations and flights (other seeds), weights and minibatches. Flights: Wilson's 95 % interval over the "
    "flights of these very policies. Trainings: Student's 95 % interval with a training as the unit.",
    "Control of: the interactive arm that a cloning arm is compared with. It has as many demonstrations as that arm "
    "had episodes in all, and either the usual optimisation steps or as many as that arm took over all its rounds.",
    "Labelled steps: every step of a demonstration, and every step at which the expert was asked. ThriftyDAgger's "
    "flights of the learner alone are not labelled and do not count as episodes; the training of its ensemble, which"
    " only decides when to ask, does not count as optimisation steps.",
    "Difference: success of each draw's interactive policy minus that of its control; Student's 95 % interval over "
    "draws.",
    "The experts are scripted, use the simulator's true state and can take over from anywhere.",
)


@dataclass(frozen=True)
class Arm:
    """One training and what it stands for.

    Attributes:
        name: of the arm. control_of: the interactive arm that it stands beside, or empty.
        training: what is trained.
    """

    name: str
    control_of: str
    training: Cloned | Asked


Results = Mapping[Arm, EvaluationResult]


@dataclass(frozen=True, kw_only=True)
class Dagger:
    """Settings.

    Attributes:
        policy: what is trained. cloning: how the controls are. noise: of the expert that demonstrates.
        asking: name -> algorithm that flies and asks. arms: which of the names; empty for all.
        robot: name. tasks: names. tier: in which everything is flown. demos: demonstrations to begin with.
        draws: of demonstrations and weights, one training of each arm each. episodes: unseen seeds per evaluation.
        first_episode: the first of them.
        num_envs: worlds flown at once in evaluations and demonstrations. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "dagger"
    question: ClassVar[str] = (
        "Does asking the expert during the learner's flights beat cloning as many of its demonstrations?"
    )

    policy: PolicySettings = field(default_factory=MLP)
    cloning: BC = field(default_factory=BC)
    noise: float = NOISE
    asking: Mapping[str, DAgger | DART] = field(
        default_factory=lambda: {JUDGED: DAgger(), "thrifty": DAgger(gate=ThriftyGate()), "dart": DART()}
    )
    arms: tuple[str, ...] = (JUDGED, "thrifty")
    robot: str = "fa_hexa_arm4"
    tasks: tuple[str, ...] = ("insert_peg", "pick_place")
    tier: str = "calm"
    demos: int = 20
    draws: tuple[int, ...] = (0, 1, 2)
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        for name in self.arms:
            if name not in self.asking:
                raise UnknownNameError("arm", name, self.asking)
        if min(self.demos, self.episodes, self.num_envs) < 1 or not self.draws:
            raise InvalidValueError("demos, episodes and num_envs start at 1; draws name at least one.")
        check_seeds(self.first_episode, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly, train and judge what ``folder`` does not hold yet; see :class:`Study`."""
        stages = Stages(record=Record(folder), num_envs=self.num_envs, threads=self.threads, progress=progress)
        seeds, arms = range(self.first_episode, self.first_episode + self.episodes), list(self.all_arms())
        results = {arm: stages.judged(arm.training, self.tier, seeds) for arm in bar(arms, self.name, progress)}
        singles = [_row(arm, [arm], results, stages) for arm in results]
        groups = list(grouped_by(results))
        pooled = [_row(group[0], group, results, stages) for group in groups]
        differences = list(differences_of(groups, results))
        return Report(
            study=self,
            targets=(*targets_of(pooled), *beside_control(differences)),
            tables={
                "Cloning and asking": pooled,
                "Asking beside its controls": differences,
                "Single trainings": [
                    {"draw": a.training.source.draw, **r} for a, r in zip(results, singles, strict=True)
                ],
            },
            notes=(*NOTES, *stages.record.notes()),
            details={"failed_seeds": {f"{a.name}: {a.training.label}": failed_seeds(r) for a, r in results.items()}},
            wall_time_s=stages.seconds(),
        )

    def all_arms(self) -> Iterator[Arm]:
        """Yield what is trained, draw by draw: each interactive arm with its controls."""
        for draw, task in product(self.draws, self.tasks):
            source = Source(robot=self.robot, task=task, tier=self.tier, noise=self.noise, draw=draw)
            yield Arm(START, "", Cloned("bc", source, self.demos, self.policy, self.cloning))
            for name in self.arms or tuple(self.asking):
                asked = Asked(name, source, self.demos, self.policy, self.asking[name])
                longer = replace(self.cloning, steps=asked.steps)
                yield Arm(name, "", asked)
                yield Arm(EPISODES, name, Cloned("bc", source, asked.episodes, self.policy, self.cloning))
                yield Arm(STEPS, name, Cloned("bc", source, asked.episodes, self.policy, longer))


def grouped_by(results: Results) -> Iterator[list[Arm]]:
    """Yield the trainings of each arm, which differ in their draws only."""
    groups: dict[tuple[str, str, str], list[Arm]] = {}
    for arm in results:
        groups.setdefault((arm.training.source.task, arm.name, arm.control_of), []).append(arm)
    yield from groups.values()


def _row(head: Arm, arms: Sequence[Arm], results: Results, stages: Stages) -> Row:
    """Return success of some trainings of one arm, and what the mean one cost."""
    costs = [_cost(arm.training, stages) for arm in arms]
    return {
        "task": head.training.source.task,
        "arm": head.name,
        "control_of": head.control_of,
        **{key: round(float(np.mean([cost[key] for cost in costs]))) for key in costs[0]},
        **{("flown" if k == "episodes" else k): v for k, v in pooled_row(results[arm] for arm in arms).items()},
        "time_s": mean_time_s(results[arm] for arm in arms),
    }


def _cost(training: Cloned | Asked, stages: Stages) -> dict[str, int]:
    """Return episodes, optimisation steps, labelled steps and questions of a training."""
    if isinstance(training, Asked):
        last = read_metrics(stages.run_of(training))[-1]
        counted = {key: int(last[f"total/{key}"]) for key in ("episodes", "labelled_steps", "queries")}
        return {"steps": training.steps, **counted}
    shown = stages.demonstrations(training.source, training.demos)
    labelled = sum(map(len, shown))
    return {
        "steps": training.algorithm.steps, "episodes": training.demos, "labelled_steps": labelled, "queries": 0
    }  # fmt: skip


def differences_of(groups: Sequence[Sequence[Arm]], results: Results) -> Iterator[Row]:
    """Yield by how much each interactive arm is better than each of its controls, paired by draw."""
    by_name = {(g[0].training.source.task, g[0].name, g[0].control_of): g for g in groups}
    for (task, name, control_of), group in by_name.items():
        if not control_of:
            continue
        asked = _rates(by_name[task, control_of, ""], results)
        row = {"task": task, "arm": control_of, "control": name}
        yield row | gain_row("difference", asked, _rates(group, results))


def _rates(arms: Sequence[Arm], results: Results) -> np.ndarray:
    """(draws,) success of each training."""
    return np.array([results[arm].success["rate"] for arm in arms])


def targets_of(pooled: Sequence[Row]) -> Iterator[Target]:
    """Yield what classic DAgger must reach on each task."""
    for row in pooled:
        if row["arm"] == JUDGED:
            yield pooled_target(f"{row['task']}: DAgger, {row['episodes']} episodes", JUDGED_PERCENT, row)


def beside_control(differences: Sequence[Row]) -> Iterator[Target]:
    """Yield that asking must not be worse than cloning as many episodes with as many optimisation steps."""
    for row in differences:
        if row["control"] == STEPS:
            known = row["low"] is not None
            spread = f"trainings {row['low']:+g} to {row['high']:+g}, {row['draws']} draws" if known else "one draw"
            what = f"{row['task']}: {row['arm']} less {STEPS}"
            yield Target(what, "at least", 0.0, row["difference"], "points", spread)
