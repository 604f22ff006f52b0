"""Flying over links: does a policy fly a robot over a link, in the robot's own time, as in its evaluation?

One policy a task is flown by the evaluation, over a link in this process whose time does not wait, and over links to
robots in other processes; each with several latencies, as if there were none (plain) and without the actions that come
too late (dropped). All are judged on the same reserved seeds.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from aerial_il.algorithms.bc import BC
from aerial_il.core.contracts import BatchEnv, Policy
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.latency import Latency
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.links.environment import LinkedEnvironment
from aerial_il.links.guard import Guard
from aerial_il.links.link import LinkError
from aerial_il.links.mavlink.link import Mavlink
from aerial_il.links.pilot import LinkPilot
from aerial_il.links.robot import SimulatedRobot
from aerial_il.links.ros2.link import Ros2
from aerial_il.links.simulated.link import Simulated
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.execution import Execution
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.suite import tasks as registered
from aerial_il.suite.late import late
from experiments.common.demonstrations import Source
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.stages import Cloned, Stages, judged_once
from experiments.common.success import failed_seeds, mean_time_s, pooled_row
from experiments.umi.study import check_latencies, latency_of

EVALUATION, HERE, ROS2, MAVLINK = "evaluation", "in_process", "ros2", "mavlink"
LINKS = (EVALUATION, HERE, ROS2, MAVLINK)
CHUNKS = ("plain", "dropped")
TIER, NOISE = "calm", 0.3
STARTED_S = 60.0  # a robot in another process compiles its world


class Cell(NamedTuple):
    """What is flown: a task over a link, with a latency, its chunks flown in a way."""

    task: str
    link: str
    latency_ms: int
    chunks: str

    @property
    def label(self) -> str:
        return f"{self.task}/{self.link}/{self.latency_ms} ms {self.chunks}"


@dataclass(frozen=True, kw_only=True)
class Links:
    """Settings.

    Attributes:
        policy: what is cloned. cloning: how. robot: that flies. tasks: which. links: over which.
        latencies_ms: of the robot, total. demos: of a clone. draw: of demonstrations and weights.
        speed: of the time of robots whose time does not wait: 1 is real. episodes: that judge a cell.
        first_episode: the first of them. num_envs: worlds flown at once by the evaluation.
        threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "links"
    question: ClassVar[str] = "Does a policy fly a robot over a link as in its evaluation?"

    policy: PolicySettings = field(default_factory=MLP)
    cloning: BC = field(default_factory=BC)
    robot: str = "ua_quad_arm4"
    tasks: tuple[str, ...] = ("reach", "pick_place")
    links: tuple[str, ...] = LINKS
    latencies_ms: tuple[int, ...] = (0, 20, 60, 100)
    demos: int = 80
    draw: int = 0
    speed: float = 2.0
    episodes: int = 50
    first_episode: int = EVALUATION_SEED
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        for task in self.tasks:
            registered.get(task)
        for link in self.links:
            if link not in LINKS:
                raise UnknownNameError("link of this study", link, LINKS)
        check_latencies(self.latencies_ms)
        if min(self.demos, self.episodes, self.num_envs) < 1 or not self.speed > 0:
            raise InvalidValueError("demos, episodes and num_envs start at 1, and speed is positive.")
        check_seeds(self.first_episode, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly, train and judge what ``folder`` does not hold yet; see :class:`Study`."""
        stages = Stages(record=Record(folder), num_envs=self.num_envs, threads=self.threads, progress=progress)
        results = {cell: self._judged(stages, cell) for cell in bar(list(self._cells()), self.name, progress)}
        return Report(
            study=self,
            targets=tuple(_targets(results)),
            tables={"Flights": [_row(cell, result) for cell, result in results.items()]},
            notes=(*NOTES, *stages.record.notes()),
            details={"failed_seeds": {cell.label: failed_seeds(result) for cell, result in results.items()}},
            wall_time_s=stages.seconds(),
        )

    def _cells(self) -> Iterator[Cell]:
        for task, link, ms, chunks in product(self.tasks, self.links, sorted(self.latencies_ms), CHUNKS):
            if ms or chunks == "plain":
                yield Cell(task, link, ms, chunks)

    def _judged(self, stages: Stages, cell: Cell) -> EvaluationResult:
        """Return how a cell is flown, flying it where the record has not got it."""
        source = Source(robot=self.robot, task=cell.task, tier=TIER, noise=NOISE, draw=self.draw)
        training = Cloned("clone", source, self.demos, self.policy, self.cloning)
        seeds = range(self.first_episode, self.first_episode + self.episodes)
        flown = {"link": cell.link, "latency_ms": cell.latency_ms, "chunks": cell.chunks, "speed": self.speed}
        decided_by = {"training": training.decided_by(), **flown, "seeds": [seeds.start, seeds.stop]}
        place = stages.record.place("evaluations", cell.label, decided_by)
        stages.places.setdefault("evaluations", {})[place] = None

        def policy() -> Policy:
            own = stages.policy(training)
            assert isinstance(own, ChunkPolicy)
            execution = Execution(chunks=cell.chunks)  # pyright: ignore[reportArgumentType]
            made = own.executing(execution, latency_of(cell.latency_ms))
            return made if cell.link == EVALUATION else LinkPilot(made)

        return judged_once(
            place, policy, lambda: self._opened(stages, source, cell), seeds, name=cell.label, progress=stages.progress
        )

    def _opened(self, stages: Stages, source: Source, cell: Cell) -> BatchEnv:
        latency = latency_of(cell.latency_ms)
        if cell.link == EVALUATION:
            return late(stages.environment(source, TIER, min(self.num_envs, self.episodes)), latency)
        if cell.link == HERE:
            settings = Simulated(clock="wall", speed=self.speed)
            return LinkedEnvironment(
                settings.connect(lambda: SimulatedRobot(self.robot, cell.task, latency=latency)), GUARD
            )
        if cell.link == MAVLINK:
            link = Mavlink().connect(lambda: SimulatedRobot(self.robot, cell.task, latency=latency))
            return LinkedEnvironment(link, GUARD)
        return Served(self.robot, cell.task, latency, self.speed)


GUARD = Guard()


class Served(LinkedEnvironment):
    """A robot in a process of its own, over ROS 2; it ends with the environment."""

    def __init__(self, robot: str, task: str, latency: Latency, speed: float) -> None:
        namespace = f"/study_{os.getpid()}_{task}"
        words = [f"latency.{name}={value:g}" for name, value in latency.said.items()]
        command = [sys.executable, "-m", "aerial_il", "simulate", "link=ros2", f"link.namespace={namespace}"]
        self._robot = subprocess.Popen([*command, f"link.speed={speed}", f"robot={robot}", f"task={task}", *words])
        super().__init__(self._connected(Ros2(namespace=namespace, speed=speed)), GUARD)

    def close(self) -> None:
        super().close()
        self._robot.terminate()
        with suppress(subprocess.TimeoutExpired):
            self._robot.wait(10.0)

    def _connected(self, settings: Ros2) -> Any:
        until = time.monotonic() + STARTED_S
        while True:
            try:
                return settings.connect(_nobody)
            except LinkError:
                if time.monotonic() > until or self._robot.poll() is not None:
                    raise


def _nobody() -> Any:
    raise AssertionError("the robot is in another process")


NOTES = (
    "One policy a task, a clone of the expert's flights in calm air with noise 0.3; another training was not measured. "
    "Intervals: Wilson's 95 % over its flights.",
    "evaluation: as aerial-il evaluate flies it. in_process: the robot's time runs on beside the policy. ros2: the "
    "robot in a process of its own, over the real middleware on one machine. mavlink: behind the stand-in autopilot, "
    "with modelled sensors and motion capture, in lockstep. Nothing of it is hardware.",
    "Latency: whole steps of 20 ms, half of them (the larger half) in what is seen, the others in what is done; that "
    "of the link comes on top. plain: chunks flown as if there were none; dropped: less actions that come too late.",
)


def _row(cell: Cell, result: EvaluationResult) -> Row:
    pooled = pooled_row([result])
    kept = {name: pooled[name] for name in ("success", "episodes", "percent", "flights_low", "flights_high")}
    return {**cell._asdict(), **kept, "time_s": mean_time_s([result]), "crashes": result.metrics["ends"]["crash"]}


def _targets(results: Mapping[Cell, EvaluationResult]) -> Iterator[Target]:
    """Yield, for each cell over a link, whether its success lies within the interval of the evaluation's."""
    for cell, result in results.items():
        control = results.get(cell._replace(link=EVALUATION))
        if cell.link == EVALUATION or control is None:
            continue
        low, high = (100 * end for end in control.success["ci95"])
        rate = 100 * result.success["rate"]
        outside = round(max(low - rate, rate - high, 0.0), 1)
        spread = f"{rate:.1f} %; the evaluation's interval {low:.1f} to {high:.1f}"
        yield Target(f"outside the evaluation's interval: {cell.label}", "at most", 0.0, outside, "points", spread)
