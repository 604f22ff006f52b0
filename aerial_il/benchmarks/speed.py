"""How fast worlds are flown: the batch environment against the bare engine and against Gymnasium's own vectorisation.

An expert's flight is recorded once and flown again by every arm, so that all do the same work, contacts included: the
bare engine is fed with the recorded actuator commands and wrenches and ends in the same state bit for bit. The arms
take turns, and ratios are formed within a turn.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import aerial_il
from aerial_il.benchmarks.parts.figures import time_shares
from aerial_il.benchmarks.parts.progress import bar
from aerial_il.benchmarks.parts.report import Report, Row, Target
from aerial_il.benchmarks.parts.stopwatch import Arm, Stopwatch, interleave
from aerial_il.benchmarks.parts.workload import RawPhysics, Workload, fly_again, record
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation.rollouts import rollouts
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.crew import available_cores
from aerial_il.suite.gymnasium_ids import gymnasium_id
from aerial_il.suite.scene import SUBSTEPS

RAW_RATIO, GYMNASIUM_RATIO = 0.8, 5.0
MANIPULATION = "pick_place"
SECTIONS = ("physics", "controller", "observation", "judgement", "bookkeeping")
NOTES = (
    "Steps per second: control steps of 20 ms (five physics steps) of all worlds together.",
    "Raw: mujoco.batch on the same model, threads and inputs, each world rolled out in one call. In step: the same, "
    "with one call per physics step, as anything that reacts to the state must.",
    "Gymnasium: AsyncVectorEnv over the single environment with the same actions, at its fastest number of processes.",
    "Ratios are medians over repetitions, with the smallest and largest; above 1 the batch environment is the faster.",
    "Time of a control step: the batch environment's own parts, timed around each call; bookkeeping counts steps, "
    "checks that states are finite and updates success and crash flags.",
    "Demonstrations: the expert from reset to success, flown alone and recorded as MCAP files.",
)


@dataclass(frozen=True, kw_only=True)
class Speed:
    """Settings.

    Attributes:
        robots, tasks: names; empty for all. num_envs: worlds of the batch. steps: control steps of the flight.
        repetitions: turns that each arm takes. processes_per_core: sizes of AsyncVectorEnv; empty leaves it out.
        demonstrations: episodes flown to count demonstrations per minute; 0 leaves them out.
        seed: the first one flown. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "speed"
    question: ClassVar[str] = "How much of the bare engine's speed does the batch environment keep?"

    robots: tuple[str, ...] = ()
    tasks: tuple[str, ...] = ()
    num_envs: int = 64
    steps: int = 250
    repetitions: int = 7
    processes_per_core: tuple[int, ...] = (1, 4)
    demonstrations: int = 128
    seed: int = 10_000
    threads: int = 0

    def __post_init__(self) -> None:
        if min(self.num_envs, self.steps, self.repetitions) < 1:
            raise InvalidValueError(
                "speed needs num_envs, steps and repetitions of at least 1; got "
                f"{self.num_envs}, {self.steps} and {self.repetitions}."
            )

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Time every cell; see :class:`Benchmark`."""
        started = time.perf_counter()
        cells = [c for c in aerial_il.list_cells() if c[0] in (self.robots or c) and c[1] in (self.tasks or c)]
        rows, shares, demonstrations, details = [], [], [], []
        for robot, task in bar(cells, self.name, progress):
            env = aerial_il.load_batch(robot, task, num_envs=self.num_envs, num_threads=self.threads)
            try:
                work = record(env, self.seed + np.arange(self.num_envs), self.steps)
                rates = self._rates(env, work)
                shares.append({"robot": robot, "task": task, **time_of_a_step(env, work)})
                if task == MANIPULATION and self.demonstrations:
                    demonstrations.append({"robot": robot, **self._demonstrations(env)})
            finally:
                env.close()
            rows.append({"robot": robot, "task": task, **_compared(rates)})
            details.append({"robot": robot, "task": task, "rates": {k: v.round(1).tolist() for k, v in rates.items()}})
        tables = {"Speed": rows, "Time of a control step": shares, "Demonstrations per minute": demonstrations}
        return Report(
            name=self.name,
            question=self.question,
            settings=asdict(self),
            targets=tuple(target for row in rows for target in _targets(row)),
            tables={title: found for title, found in tables.items() if found},
            notes=NOTES,
            figures={"speed.svg": time_shares(shares, [f"{name}_us" for name in SECTIONS])},
            details={"repetitions": details},
            wall_time_s=time.perf_counter() - started,
        )

    def _rates(self, env: BatchEnvironment, work: Workload) -> dict[str, np.ndarray]:
        """Control steps per second of each arm, one number per repetition."""
        raw = RawPhysics(env.model, work, self.threads)
        arms = {
            "batch": Arm(
                lambda: fly_again(env, work), units=work.world_steps, prepare=lambda: env.set_state(work.start)
            ),
            "raw": Arm(raw.roll_out, units=work.world_steps, prepare=raw.rewind),
            "raw in step": Arm(raw.step_together, units=work.world_steps, prepare=raw.rewind),
        }
        with self._gymnasium_arms(env, work) as others:
            return interleave({**arms, **others}, self.repetitions)

    @contextmanager
    def _gymnasium_arms(self, env: BatchEnvironment, work: Workload) -> Iterator[dict[str, Arm]]:
        """AsyncVectorEnv at every size, its processes up as long as the context lasts."""
        import gymnasium

        cores = self.threads or available_cores()
        sizes = sorted({min(cores * each, self.num_envs) for each in self.processes_per_core})
        name = f"aerial_il:{gymnasium_id(env.spec.robot, env.spec.task)}"
        make = partial(gymnasium.make, name, disable_env_checker=True)
        # "spawn": threads are running by now, forking would be unsafe
        made = {n: gymnasium.vector.AsyncVectorEnv([make] * n, context="spawn") for n in sizes}
        try:
            yield {f"gymnasium, {n} processes": self._gymnasium_arm(vector, work) for n, vector in made.items()}
        finally:
            for vector in made.values():
                vector.close()

    def _gymnasium_arm(self, vector: Any, work: Workload) -> Arm:
        seeds = [self.seed + i for i in range(vector.num_envs)]
        actions = work.actions[:, : vector.num_envs]

        def fly() -> None:
            for action in actions:
                vector.step(action)

        return Arm(fly, units=actions.shape[0] * actions.shape[1], prepare=lambda: vector.reset(seed=seeds))

    def _demonstrations(self, env: BatchEnvironment) -> Row:
        """Successful episodes of the expert per minute, flown alone and recorded, and what the resets cost."""
        robot, task, clock = env.spec.robot, env.spec.task, Stopwatch()
        seeds = range(self.seed, self.seed + self.demonstrations)
        with clock.section("flown"):
            flights = list(rollouts(env, aerial_il.expert(robot, task), seeds))
        with tempfile.TemporaryDirectory(prefix="aerial_il-") as folder, clock.section("recorded"):
            recorded = collect(env, aerial_il.expert(robot, task), seeds, folder, progress=False)
        with clock.section("resets"):
            env.reset(self.seed)
        resets = clock.seconds["resets"] * len(flights) / env.num_envs
        return {
            "flown_per_minute": round(60 * sum(f.success for f in flights) / clock.seconds["flown"]),
            "recorded_per_minute": round(60 * len(recorded.demos) / clock.seconds["recorded"]),
            "mean_steps": round(float(np.mean([len(f) for f in flights]))),
            "resets_percent": round(100 * resets / clock.seconds["flown"], 2),
        }


def time_of_a_step(env: BatchEnvironment, work: Workload) -> Row:
    """Return µs per world and control step of each part of the batch environment's step, and of them all together."""
    simulation, clock = env.simulation, Stopwatch()
    env.set_state(work.start)
    for actions in work.actions:
        with clock.section("controller"):
            simulation.receive(actions)
        for _ in range(SUBSTEPS):
            with clock.section("controller"):
                simulation.control()
            with clock.section("physics"):
                simulation.worlds.step(None)
        with clock.section("bookkeeping"):
            simulation.settle()
        with clock.section("judgement"):
            simulation.judge()
        with clock.section("observation"):
            env.observe()
    parts = {f"{name}_us": 1e6 * clock.seconds[name] / work.world_steps for name in SECTIONS}
    rounded = {name: round(value, 2) for name, value in parts.items()}
    return {**rounded, "total_us": round(sum(parts.values()), 2)}


def _compared(rates: dict[str, np.ndarray]) -> Row:
    """The arms' median speeds, and the batch environment's ratio to each."""
    batch = rates["batch"]
    others = {name: rate for name, rate in rates.items() if name.startswith("gymnasium")}
    best = max(others, key=lambda name: float(np.median(others[name])), default="")
    row: Row = {"steps_per_s": round(float(np.median(batch)))}
    for label, name in (("raw", "raw"), ("in_step", "raw in step"), ("gymnasium", best)):
        if name:
            ratio = batch / rates[name]
            row[f"{label}_steps_per_s"] = round(float(np.median(rates[name])))
            row[f"ratio_{label}"] = round(float(np.median(ratio)), 3)
            row[f"range_{label}"] = f"{ratio.min():.2f}-{ratio.max():.2f}"
    return row


def _targets(row: Row) -> list[Target]:
    wanted = (
        ("raw", RAW_RATIO, "batch environment / raw mj_step"),
        ("gymnasium", GYMNASIUM_RATIO, "batch environment / AsyncVectorEnv"),
    )
    return [
        Target(
            what=f"{row['robot']}, {row['task']}: {what}",
            sense="at least",
            limit=limit,
            measured=row[f"ratio_{key}"],
            spread=f"{row[f'range_{key}']} over repetitions",
        )
        for key, limit, what in wanted
        if f"ratio_{key}" in row
    ]


BENCHMARK = Speed
