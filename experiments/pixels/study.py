"""Flying by camera: policies that see images and their own robot, but no object, on unseen seeds.

Two routes side by side, from the same demonstrations: a policy of the state in front of which networks estimate what it
is shown (:mod:`aerial_il.algorithms.perception`), with and without labels from its own flights, and one network from
images to actions, with and without the auxiliary loss, and with the expert asked in its own flights. Beside them the
same policy on the truth, which nothing can exceed, and the first route with its images blanked, or with the first frame
shown for ever: what these reach needs no eyes. Every stage is kept by all that decides it: killed at any moment, the
same call continues.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import aerial_il
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.dagger import DAgger
from aerial_il.algorithms.interactive.gates.coin import CoinGate
from aerial_il.algorithms.perception import Perception
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.collection.collect import collect
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.rendering import require_rendering
from aerial_il.core.specs import camera_name
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies import load_policy
from aerial_il.policies.act import ACT
from aerial_il.policies.diffusion import Diffusion
from aerial_il.policies.flow import Flow
from aerial_il.policies.lerobot_act import LerobotACT
from aerial_il.policies.lerobot_diffusion import LerobotDiffusion
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.layout import TO_BE_SEEN
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.perception.policy import PerceivingPolicy
from aerial_il.policies.recurrent import Recurrent
from aerial_il.suite import tiers
from experiments.common.demonstrations import NOISE, Generated, Source
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.stages import Asked, Cloned, Shown, Stages, all_that_decides, judged_once
from experiments.common.success import failed_seeds, macro_row, pooled_row
from experiments.pixels.changes import BLANK, CHANGES, CONTROLS, changed
from experiments.pixels.looks import IN_VIEW, begins_in_view, row_of_times, rows_of_starts

FLOWN, SHOWN, END_TO_END, TRUTH = "perception", "perception, no own flights", "end to end", "truth"
TOLD, ASKED = "end to end, auxiliary loss", "end to end, dagger"
UNMOVED, PAINTED = "perception, no redrawn scenes", "perception, learned in looks"
SEEING = (FLOWN, SHOWN, UNMOVED, PAINTED)
LOOKS = "+looks:1"  # of what PAINTED learns from
AFFORDABLE = (FLOWN, SHOWN, END_TO_END, TRUTH)
OTHERS = (ACT(), Recurrent(), Diffusion(), Flow(), LerobotACT(), LerobotDiffusion())
HEADS: Mapping[str, PolicySettings] = {  # arm of one network from images to actions -> what acts on what is seen
    END_TO_END: MLP(),
    **{f"{END_TO_END}, {each.name}": each for each in OTHERS},
}
ARMS = (*AFFORDABLE, TOLD, ASKED, UNMOVED, PAINTED, *list(HEADS)[1:])
TASKS = (
    "reach", "track", "pick_place", "press_button", "push_slider", "inspect_contact", "pull_lever", "open_door",
    "rotate_valve", "insert_peg",
)  # fmt: skip
MACRO = "all tasks"
MACRO_PERCENT = {(FLOWN, "calm"): 80.0, (FLOWN, "gusts"): 65.0, (SHOWN, "calm"): 60.0}
TASK_PERCENT = {"pick_place": 95.0, "press_button": 90.0, "insert_peg": 70.0}
STARTS_PERCENT = {"reach": 80.0}  # of the flights that begin with the target in view
BLIND_PERCENT, MOST_MIN, MOST_MS = 20.0, 60.0, 20.0
NOTES = (
    "The final policy of each training, none selected. Trainings of an arm differ in their draw: demonstrations (other "
    "seeds), weights and minibatches.",
    "All arms but truth act on images, the robot's own state and what it feels at its wrist; where objects are is "
    "hidden from them (observations=onboard). truth: the same policy on all that the simulator knows.",
    "Labels: frames with what was to be seen in them: of the demonstrations, of these redrawn with the objects "
    "elsewhere, and of the policy's own flights, whose number is told.",
    "Starts: in view are flights at whose start every place that is estimated lies within some camera's image, by "
    "geometry: what hides it does not count. Time: one world on one thread, the first task's training of each; render "
    "has a step's physics in it, act goes from images to the action.",
    "All tasks: of the draws that every task was trained of.",
)


@dataclass(frozen=True, eq=False)
class Perceived(Shown):
    """A policy of the state with eyes.

    Attributes:
        algorithm: how it learns to see. looks: what is added to the tier in which it looks and flies while it learns.
    """

    algorithm: Perception
    looks: str = ""

    def decided_by(self) -> dict[str, Any]:
        return {**all_that_decides(self), **({"looks": self.looks} if self.looks else {})}

    def train(self, stages: Stages, run: Path) -> Policy:
        source = self.source
        env = stages.environment(source, source.tier + self.looks, self.algorithm.worlds)
        try:
            shown = stages.demonstrations(source, self.demos, cameras=self.policy.images)
            return self.algorithm.train(
                shown, self.policy, run=run, env=env, collect=collect, seed=source.draw, progress=stages.progress
            )
        finally:
            env.close()


@dataclass(frozen=True)
class Flight:
    """A training that is judged in a tier, with its images as they are, or changed."""

    training: Perceived | Cloned | Asked
    tier: str
    changed: str = ""

    @property
    def arm(self) -> Row:
        """The key of a table's row."""
        source = self.training.source
        out_of = f"out of {source.few}" if isinstance(source, Generated) else ""
        method = ", ".join(filter(None, (self.training.method, out_of, self.changed)))
        return {"sees": method, "tier": self.tier, "demos": self.training.demos, "task": source.task}


Results = Mapping[Flight, EvaluationResult]


@dataclass(frozen=True, kw_only=True)
class Pixels:
    """Settings.

    Attributes:
        policy: of the state. perception: how networks learn to see for it.
        heads, cloning: the other route, arm -> policy from images to actions, and how all of these are cloned.
        asking: how it goes on in its own flights, where it does; each time it learns as ``cloning`` says.
        noise: of the expert that demonstrates. robot, tasks: which cells; arms: of ``ARMS``.
        cameras, image_size: what is seen, height and width in pixels.
        demos: demonstrations of each task. sizes: other numbers of them, tried calm with the first arm.
        few: all these are generated, with images, out of so many; 0: the expert flies them all.
        flown_in: tiers of evaluations. changes: what the first arm's first training is deprived of besides, in
            the first of them.
        draws: of demonstrations and weights, one training each. repeated: tasks of which all draws are trained, and of
            the others the first alone. episodes: unseen seeds per evaluation.
        first_episode: the first of them; 5000 to try settings out. timed: control steps of one world that are timed.
        num_envs: worlds flown at once. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "pixels"
    question: ClassVar[str] = "How well do policies fly by camera, and at what cost?"

    policy: PolicySettings = field(default_factory=MLP)
    perception: Perception = Perception()
    heads: Mapping[str, PolicySettings] = field(default_factory=lambda: dict(HEADS))
    cloning: BC = BC(steps=8_000, batch_size=64, mixed_precision=True)
    asking: DAgger = DAgger(rounds=3, episodes=60, between_steps=3_000, evaluate_every=0, gate=CoinGate(beta="zero"))
    noise: float = NOISE
    robot: str = "fa_hexa_arm4"
    tasks: tuple[str, ...] = TASKS
    arms: tuple[str, ...] = AFFORDABLE
    cameras: tuple[str, ...] = ("wrist_rgb", "base_rgb")
    image_size: tuple[int, int] = (64, 64)
    demos: int = 80
    sizes: tuple[int, ...] = ()
    few: int = 0
    flown_in: tuple[str, ...] = ("calm", "gusts")
    changes: tuple[str, ...] = CONTROLS
    draws: tuple[int, ...] = (0, 1, 2)
    repeated: tuple[str, ...] = tuple(TASK_PERCENT)
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    timed: int = 500
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        able = [task for robot, task in aerial_il.list_cells() if robot == self.robot]
        said = ((self.tasks, able, "task"), (self.arms, ARMS, "arm"), (self.changes, CHANGES, "change"))
        for names, valid, what in said:
            for name in names:
                if name not in valid:
                    raise UnknownNameError(what, name, valid)
        for tier in self.flown_in:
            tiers.get(tier)
        if set(self.heads) != set(HEADS):
            raise InvalidValueError(f"heads are of the arms {', '.join(HEADS)}; {', '.join(self.heads)} are given.")
        if min(self.demos, self.episodes, *self.sizes) < 1 or self.few < 0:
            raise InvalidValueError("demos, sizes and episodes start at 1, few at 0.")
        if not all((self.draws, self.arms, self.cameras, self.tasks, self.flown_in)):
            raise InvalidValueError("draws, arms, cameras, tasks and flown_in name at least one each.")
        if (lost := {*self.changes} - {*CONTROLS}) and self.arms[0] not in SEEING:
            raise InvalidValueError(
                f"{', '.join(sorted(lost))}: only policies with eyes can be deprived of it, and the first arm is "
                f"{self.arms[0]!r}. Begin with one of {', '.join(SEEING)}, or leave {', '.join(CONTROLS)}."
            )
        check_seeds(self.first_episode, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Collect, train and evaluate what ``folder`` does not hold yet; see :class:`Study`."""
        require_rendering("bench pixels")
        most = max((self.demos, *self.sizes))
        stages = Stages(
            record=Record(folder), num_envs=self.num_envs, threads=self.threads, progress=progress, most=most
        )
        flights = list(self.planned())
        results = {flight: self._judged(stages, flight) for flight in bar(flights, self.name, progress)}
        usual = {f: r for f, r in results.items() if f.training.demos == self.demos}
        per_task, macro = [*_per_task(usual, stages)], [*macro_rows(usual)]
        scaling = [*_per_task(results, stages)] if self.sizes else []
        seeing = {flight: result for flight, result in usual.items() if self._sees(flight)}
        starts = [flight.arm | row for flight, result in seeing.items() for row in self._starts(stages, flight, result)]
        times = [
            {"task": flight.training.source.task, **self._times(stages, flight)}
            for flight in seeing
            if flight.training.source.draw == self.draws[0] and flight.training.method == self.arms[0]
        ]
        return Report(
            study=self,
            targets=(*self.targets_of(macro, per_task, starts), *_in_time(times)),
            tables={
                name: rows
                for name, rows in (
                    ("All tasks", macro),
                    ("Each task", per_task),
                    ("Over demonstrations", scaling),
                    ("Starts", starts),
                    ("Time of one world", times),
                )
                if rows
            },
            notes=(*NOTES, *stages.record.notes()),
            details={
                "failed_seeds": {
                    f"{f.training.label}/{f.tier}/{f.changed}": failed_seeds(r) for f, r in results.items()
                }
            },
            wall_time_s=stages.seconds(),
        )

    def planned(self) -> Iterator[Flight]:
        """Yield what is flown, draw by draw, then fewer and more demonstrations."""
        for draw, arm, task in product(self.draws, self.arms, self.tasks):
            if draw != self.draws[0] and task not in self.repeated:
                continue
            training = self._training(arm, task, draw, self.demos)
            for tier in self.flown_in:
                yield Flight(training, tier)
            if (arm, draw) == (self.arms[0], self.draws[0]):
                yield from (Flight(training, self.flown_in[0], changed) for changed in self.changes)
        for draw, demos, task in product(self.draws, sorted({*self.sizes} - {self.demos}), self.tasks):
            yield Flight(self._training(self.arms[0], task, draw, demos), self.flown_in[0])

    def _sees(self, flight: Flight) -> bool:
        """Return whether it is one of a policy with eyes, in the first tier, with its images as they are."""
        return flight.tier == self.flown_in[0] and not flight.changed and isinstance(flight.training, Perceived)

    def _starts(self, stages: Stages, flight: Flight, result: EvaluationResult) -> list[Row]:
        with closing(stages.environment(flight.training.source, flight.tier, self.num_envs)) as env:
            seeds = [episode.seed for episode in result.episodes]
            return [*rows_of_starts(result, begins_in_view(env, _eyed(stages, flight), seeds))]

    def _times(self, stages: Stages, flight: Flight) -> Row:
        with closing(stages.environment(flight.training.source, flight.tier, 1)) as env:
            return row_of_times(env, _eyed(stages, flight), self.first_episode, self.timed)

    def _training(self, arm: str, task: str, draw: int, demos: int) -> Perceived | Cloned | Asked:
        cameras = tuple(map(camera_name, self.cameras))
        source = Source(
            robot=self.robot, task=task, noise=self.noise, draw=draw, cameras=cameras, image_size=self.image_size
        )
        if self.few:
            source = Generated(few=self.few, **asdict(source))
        if arm == TRUTH:
            return Cloned(arm, source, demos, self.policy, self.perception.training)
        if arm in (*self.heads, TOLD, ASKED):
            return self._end_to_end(arm, source, demos)
        less = {SHOWN: {"rounds": 0}, UNMOVED: {"redrawn": 0}}
        algorithm = replace(self.perception, **less.get(arm, {}))
        looks = LOOKS if arm == PAINTED else ""
        return Perceived(arm, source, demos, replace(self.policy, images=self.cameras), algorithm, looks)

    def _end_to_end(self, arm: str, source: Source, demos: int) -> Cloned | Asked:
        seeing = replace(self.heads.get(arm, self.heads[END_TO_END]), images=self.cameras)
        hidden = replace(seeing, masked_fields=(*seeing.masked_fields, TO_BE_SEEN))
        if arm == ASKED:
            return Asked(arm, source, demos, hidden, replace(self.asking, training=self.cloning))
        cloning = replace(self.cloning, auxiliary=1.0) if arm == TOLD else self.cloning
        return Cloned(arm, source, demos, hidden, cloning)

    def _judged(self, stages: Stages, flight: Flight) -> EvaluationResult:
        training, seeds = flight.training, range(self.first_episode, self.first_episode + self.episodes)
        if not flight.changed:
            return stages.judged(training, flight.tier, seeds, images=bool(training.policy.images))
        where = {"tier": flight.tier, "seeds": [seeds.start, seeds.stop], "changed": flight.changed}
        stages.run_of(training)
        return judged_once(
            stages.place(
                "evaluations",
                f"{training.label}/{flight.tier}-{flight.changed.split()[0]}",
                {"training": training.decided_by(), **where},
            ),
            lambda: changed(stages.policy(training), flight.changed, self.cameras),
            lambda: stages.environment(training.source, flight.tier, min(self.num_envs, len(seeds))),
            seeds,
            name=training.label,
            progress=stages.progress,
        )

    def targets_of(self, macro: Sequence[Row], per_task: Sequence[Row], starts: Sequence[Row]) -> Iterator[Target]:
        """Yield the targets, of what was flown in full."""
        for row in macro:
            if {*TASKS} <= {*self.tasks} and (wanted := MACRO_PERCENT.get((row["sees"], row["tier"]))):
                yield _target(f"{row['sees']}, {row['tier']}: mean success of {len(self.tasks)} tasks", wanted, row)
            if row["sees"] == f"{FLOWN}, {BLANK}":
                yield Target(f"{row['sees']}: mean success", "at most", BLIND_PERCENT, row["percent"], "%")
        for row in starts:
            wanted = STARTS_PERCENT.get(row["task"])
            if wanted and (row["sees"], row["starts"]) == (FLOWN, IN_VIEW):
                yield _target(
                    f"{row['task']}, {FLOWN}: success of flights that begin with the target in view", wanted, row
                )
        for row in per_task:
            if (row["sees"], row["tier"]) == (FLOWN, "calm"):
                if row["task"] in TASK_PERCENT:
                    yield _target(f"{row['task']}, {FLOWN}: success", TASK_PERCENT[row["task"]], row)
                yield Target(f"{row['task']}, {FLOWN}: training", "at most", MOST_MIN, row["train_min"], "min")


def _eyed(stages: Stages, flight: Flight) -> PerceivingPolicy:
    """Return the policy of a training that is finished."""
    policy = load_policy(stages.run_of(flight.training))
    assert isinstance(policy, PerceivingPolicy)
    return policy


def _in_time(rows: Sequence[Row]) -> Iterator[Target]:
    for row in rows:
        what = f"{row['task']}: rendering, physics and policy of a step of one world, 99th percentile"
        yield Target(what, "at most", MOST_MS, row["both_p99_ms"], "ms", f"median {row['both_median_ms']} ms")


def grouped(results: Results, *names: str) -> Iterator[tuple[Row, Results]]:
    """Group flights by some of their properties, in the order in which they were flown."""
    groups: dict[tuple[Any, ...], dict[Flight, EvaluationResult]] = {}
    for flight, result in results.items():
        groups.setdefault(tuple(flight.arm[name] for name in names), {})[flight] = result
    return ((dict(zip(names, key, strict=True)), found) for key, found in groups.items())


def _per_task(results: Results, stages: Stages) -> Iterator[Row]:
    for arm, found in grouped(results, "sees", "tier", "demos", "task"):
        runs = [stages.run_of(flight.training) for flight in found]
        own = [_own_flights(run, arm["demos"]) for run in runs]
        cost = {"own_flights": round(float(np.mean(own))), "train_min": stages.minutes(f.training for f in found)}
        yield {**arm, **pooled_row(found.values()), **cost}


def _own_flights(run: Path, demos: int) -> float:
    """Return how many flights of its own a training has learned from."""
    last = read_metrics(run)[-1]
    return last.get("total/episodes", demos + last.get("flights", 0.0)) - demos


def macro_rows(results: Results) -> Iterator[Row]:
    """Yield means over tasks, of the draws that all of them have."""
    for arm, found in grouped(results, "sees", "tier", "demos"):
        tasks = {
            of["task"]: {f.training.source.draw: r for f, r in flown.items()} for of, flown in grouped(found, "task")
        }
        shared = sorted(set.intersection(*({*draws} for draws in tasks.values())))
        yield {**arm, **macro_row({task: [draws[draw] for draw in shared] for task, draws in tasks.items()})}


def _target(what: str, wanted: float, row: Row) -> Target:
    spread = f"{row['flights_low']:g}-{row['flights_high']:g} over flights"
    return Target(what, "at least", wanted, row["percent"], "%", spread)
