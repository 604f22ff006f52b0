"""Demonstrations by a gripper without a vehicle: how what was cloned from them flies on vehicles with latency.

A policy that sees and commands the tool alone is trained once for each task, on flights of ``floating_gripper``, which
stands for a gripper in somebody's hand. It flies on that gripper and on three vehicles, each with several latencies,
and executes its chunks in several ways. Control: the same policy trained on as many flights of the vehicle itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import ClassVar

import aerial_il
from aerial_il import robots
from aerial_il.algorithms.bc import BC
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.latency import Latency
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies import load_policy
from aerial_il.policies.diffusion import Diffusion
from aerial_il.policies.parts.embodiment import Follower
from aerial_il.policies.parts.execution import Execution
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.suite import tasks as registered
from aerial_il.suite.late import late
from experiments.common.demonstrations import NOISE, Source
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.stages import Cloned, Stages, judged_once
from experiments.common.success import failed_seeds, mean_time_s, pooled_row

TIER, STEP_MS = "calm", 20
PLAIN, DROPPED, REALTIME, GUIDED = "plain", "dropped", "realtime", "guided"
WAYS = {
    PLAIN: Execution(),
    DROPPED: Execution(chunks="dropped"),
    REALTIME: Execution(chunks="realtime"),
    GUIDED: Execution(chunks="dropped", guidance=1.5),
}
OWN = "own"  # demonstrations of the vehicle that flies
FLOWN, LOST, GAINED = 80.0, 10.0, 0.0  # %, points, points
OF_THE_TOOL = Diffusion(relative=True, masked_fields=("gripper", "wrist_force", "base_*", "joint_*", "ee_*"))


@dataclass(frozen=True)
class Cell:
    """Where a policy flies, and how: whose demonstrations it learned from, on what robot, how late, by which way."""

    task: str
    shown_by: str
    robot: str
    latency_ms: int
    way: str

    @property
    def label(self) -> str:
        """Its name for people, a path."""
        return f"{self.shown_by}-{self.task}/{self.robot}/{self.latency_ms}ms-{self.way}"


@dataclass(frozen=True, kw_only=True)
class Umi:
    """Settings.

    Attributes:
        policy: what is trained. cloning: how.
        demonstrator: whose flights it learns from. demos: how many. draw: which of several draws of them.
        tasks: that are done. robots: that fly. latencies_ms: how late they are, half of it in what they see.
        ways: how chunks are flown.
        episodes: that judge a cell. first_episode: the first.
        num_envs: worlds flown at once. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "umi"
    question: ClassVar[str] = "How does a policy taught by a gripper without a vehicle fly on vehicles with latency?"

    policy: PolicySettings = field(default_factory=lambda: OF_THE_TOOL)
    cloning: BC = BC(steps=5_000, validation=0.0)
    demonstrator: str = "floating_gripper"
    demos: int = 100
    draw: int = 0
    tasks: tuple[str, ...] = ("pick_place", "press_button")
    robots: tuple[str, ...] = ("fa_hexa_arm4", "ua_quad_arm4", "big_four_z1")
    latencies_ms: tuple[int, ...] = (0, 100, 60, 20)
    ways: tuple[str, ...] = tuple(WAYS)
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        for task in self.tasks:
            registered.get(task)
        for way in self.ways:
            if way not in WAYS:
                raise UnknownNameError("way", way, WAYS)
        check_latencies(self.latencies_ms)
        if min(self.demos, self.episodes, self.num_envs) < 1:
            raise InvalidValueError("demos, episodes and num_envs start at 1.")
        check_seeds(self.first_episode, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly, train and judge what ``folder`` does not hold yet; see :class:`Study`."""
        stages = Stages(record=Record(folder), num_envs=self.num_envs, threads=self.threads, progress=progress)
        cells = bar(sorted(self._cells(), key=self._urgency), self.name, progress)
        found = {cell: self._judged(stages, cell) for cell in cells}
        results = {cell: found[cell] for cell in self._cells()}
        return Report(
            study=self,
            targets=(*_targets(results),),
            tables={"Flights": [_row(cell, result) for cell, result in results.items()]},
            notes=(*NOTES, *stages.record.notes()),
            details={"failed_seeds": {cell.label: failed_seeds(result) for cell, result in results.items()}},
            wall_time_s=stages.seconds(),
        )

    def _cells(self) -> Iterator[Cell]:
        """Yield all cells: without latency nothing is dropped or joined, and controls fly chunks as trained."""
        able = aerial_il.list_cells()
        late = sorted(self.latencies_ms)
        for task, robot in product(self.tasks, (self.demonstrator, *self.robots)):
            if (robot, task) not in able:
                continue
            others = robot != self.demonstrator
            for ms, way in product(late, self.ways):
                if way == GUIDED and Follower.of(robots.get(robot)) == Follower.of(robots.get(self.demonstrator)):
                    continue
                if way == PLAIN or (others and (ms or way == GUIDED)):
                    yield Cell(task, self.demonstrator, robot, ms, way)
            if others:
                yield from (Cell(task, OWN, robot, ms, PLAIN) for ms in (late[0], late[-1]))

    def _urgency(self, cell: Cell) -> tuple[int, ...]:
        """Return what is flown first: one task, all robots, the latencies in the order in which they were named."""
        ways = [*self.ways]
        return (
            self.tasks.index(cell.task), cell.shown_by == OWN, self.latencies_ms.index(cell.latency_ms),
            ways.index(cell.way) if cell.way in ways else 0,
        )  # fmt: skip

    def _judged(self, stages: Stages, cell: Cell) -> EvaluationResult:
        """Return how a policy flies in a cell, flying it where the record has not got it."""
        shown_by = cell.robot if cell.shown_by == OWN else cell.shown_by
        source = Source(robot=shown_by, task=cell.task, tier=TIER, noise=NOISE, draw=self.draw)
        training = Cloned("tool", source, self.demos, self.policy, self.cloning)
        seeds = range(self.first_episode, self.first_episode + self.episodes)
        latency, execution = latency_of(cell.latency_ms), WAYS[cell.way]
        told = {"robot": cell.robot, "latency": latency.said, "execution": execution.said}
        decided_by = {"training": training.decided_by(), **told, "seeds": [seeds.start, seeds.stop]}
        place = stages.record.place("evaluations", cell.label, decided_by)
        stages.places.setdefault("evaluations", {})[place] = None
        flown = Source(robot=cell.robot, task=cell.task, tier=TIER)
        return judged_once(
            place,
            lambda: load_policy(_trained(stages, training)).executing(execution, latency),
            lambda: late(stages.environment(flown, TIER, min(self.num_envs, self.episodes)), latency),
            seeds,
            name=cell.label,
            progress=stages.progress,
        )


def _trained(stages: Stages, training: Cloned) -> Path:
    """Return the folder of a training that is finished."""
    stages.policy(training)
    return stages.run_of(training)


NOTES = (
    "One policy a task, a diffusion policy that sees and commands the tool alone, of flights in calm air with noise "
    "0.3 by demonstrator or, as a control (own), by the vehicle itself. Intervals: Wilson's 95 % over the flights of "
    "that one policy; another training was not measured.",
    "Latency: whole steps of 20 ms, half of them (the larger half) in what is seen, the others in what is done. plain: "
    "chunks as without latency; dropped: less the actions that come too late; realtime: moreover joined while "
    "denoising, a new one every 10 steps; guided: dropped, and led to what a model of the vehicle can follow, guidance "
    "1.5. fa_hexa_arm4 has no guided row: its model is that of the demonstrator.",
)


def check_latencies(latencies_ms: Iterable[int]) -> None:
    """Refuse latencies that are no whole number of control steps."""
    if wrong := [ms for ms in latencies_ms if ms < 0 or ms % STEP_MS]:
        raise InvalidValueError(f"latencies_ms has {wrong}; they are multiples of {STEP_MS}, from 0 on.")


def latency_of(total_ms: int) -> Latency:
    """Return a latency of that length, the larger half of its steps in what is seen."""
    done = STEP_MS * (total_ms // STEP_MS // 2)
    return Latency(observation_delay_ms=total_ms - done, action_delay_ms=done)


def _row(cell: Cell, result: EvaluationResult) -> Row:
    head = {
        "task": cell.task, "demonstrator": cell.shown_by, "robot": cell.robot, "latency_ms": cell.latency_ms,
        "way": cell.way,
    }  # fmt: skip
    pooled = pooled_row([result])
    kept = {name: pooled[name] for name in ("success", "episodes", "percent", "flights_low", "flights_high")}
    return {**head, **kept, "time_s": mean_time_s([result]), "crashes": result.metrics["ends"]["crash"]}


def _targets(results: Mapping[Cell, EvaluationResult]) -> Iterator[Target]:
    percent = {cell: 100 * result.success["rate"] for cell, result in results.items()}
    for cell, rate in percent.items():
        if cell.shown_by in (OWN, cell.robot):
            continue
        name, still = f"{cell.robot}, {cell.task}", Cell(cell.task, cell.shown_by, cell.robot, 0, PLAIN)
        plain = Cell(cell.task, cell.shown_by, cell.robot, cell.latency_ms, DROPPED if cell.latency_ms else PLAIN)
        if cell == still:
            yield Target(f"flown without latency: {name}", "at least", FLOWN, round(rate, 1), "%")
        elif cell.way == DROPPED and still in percent:
            lost = round(percent[still] - rate, 1)
            yield Target(f"lost by {cell.latency_ms} ms, late actions dropped: {name}", "at most", LOST, lost, "points")
        elif cell.way == GUIDED and plain in percent:
            gained = round(rate - percent[plain], 1)
            yield Target(f"gained by guidance at {cell.latency_ms} ms: {name}", "at least", GAINED, gained, "points")
