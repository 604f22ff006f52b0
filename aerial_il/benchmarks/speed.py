"""How fast worlds are flown: the batch environment against the bare engine and against Gymnasium's own vectorisation.

An expert's flight is recorded once and flown again by every arm, so that all do the same work, contacts included: the
bare engine is fed with the recorded actuator commands and wrenches and ends in the same state bit for bit. The arms
take turns, and ratios are formed within a turn.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

import aerial_il
from aerial_il.benchmarks.parts.figures import time_shares
from aerial_il.benchmarks.parts.processes import process_arms
from aerial_il.benchmarks.parts.progress import bar
from aerial_il.benchmarks.parts.report import Report, Row, Target
from aerial_il.benchmarks.parts.stopwatch import Arm, Stopwatch, interleave
from aerial_il.benchmarks.parts.workload import RawPhysics, Workload, fly_again, record
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation.rollouts import rollouts
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.scene import SUBSTEPS

MANIPULATION = "pick_place"
RAW_RATIO, RAW_RATIO_MANIPULATION = 0.8, 0.85
GYMNASIUM_RATIO, SB3_RATIO = 3.5, 4.0
DEMONSTRATIONS_PER_MINUTE, RESETS_PERCENT = 3000, 3.0
FLOWN_ALONE = 8  # demonstrations that one environment at a time flies for comparison
SECTIONS = ("flight", "observation", "judgement", "bookkeeping")
NOTES = (
    "Steps per second: control steps of 20 ms (five physics steps) of all worlds together.",
    "Raw: mujoco.batch on the same model, threads and inputs, one call per control step, for a policy has to see all "
    "worlds before it acts. Untimed: the same without the timers that MuJoCo's Python package switches on, and we off. "
    "Uninterrupted: in one call for the whole flight, which keeps each world in cache.",
    "Gymnasium: AsyncVectorEnv, SB3: Stable-Baselines3's SubprocVecEnv, over the single environment with the same "
    "actions, in pick_place; each of their processes steps one world.",
    "Ratios are medians over repetitions, with the smallest and largest; above 1 the batch environment is the faster.",
    "Time of a control step: the batch environment's own parts, timed around each call; flight is controller, "
    "air and physics; bookkeeping checks actions and states, counts steps and updates success and crash flags.",
    "Demonstrations: the expert from reset to success, flown without recording, and recorded as MCAP files; one at a "
    "time: the same with a single world.",
)


@dataclass(frozen=True, kw_only=True)
class Speed:
    """Settings.

    Attributes:
        robots, tasks: names; empty for all. num_envs: worlds of the batch. steps: control steps of the flight.
        repetitions: turns that each arm takes. processes: of the other libraries, in pick_place; 0 leaves them out.
        demonstrations: episodes flown to count demonstrations per minute; 0 leaves them out.
        seed: the first one flown. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "speed"
    question: ClassVar[str] = "How much of the bare engine's speed does the batch environment keep?"

    robots: tuple[str, ...] = ()
    tasks: tuple[str, ...] = ()
    num_envs: int = 256
    steps: int = 60
    repetitions: int = 7
    processes: int = 8
    demonstrations: int = 1024
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
            targets=(*(t for row in rows for t in _targets(row)), *(t for row in demonstrations for t in _goals(row))),
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
            "raw": Arm(raw.step, units=work.world_steps, prepare=raw.rewind),
            "untimed": Arm(raw.step_untimed, units=work.world_steps, prepare=raw.rewind),
            "uninterrupted": Arm(raw.roll_out, units=work.world_steps, prepare=raw.rewind),
        }
        count = min(self.processes, self.num_envs) if env.spec.task == MANIPULATION else 0
        with process_arms(env.spec.robot, env.spec.task, count, self.seed, work.actions) as others:
            return interleave({**arms, **others}, self.repetitions)

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
        alone = aerial_il.load_batch(robot, task, num_envs=1)
        with clock.section("alone"):
            single = list(rollouts(alone, aerial_il.expert(robot, task), seeds[:FLOWN_ALONE]))
        alone.close()
        flown = 60 * sum(f.success for f in flights) / clock.seconds["flown"]
        resets = clock.seconds["resets"] * len(flights) / env.num_envs
        return {
            "flown_per_minute": round(flown),
            "recorded_per_minute": round(60 * len(recorded.demos) / clock.seconds["recorded"]),
            "one_at_a_time": round(60 * len(single) / clock.seconds["alone"]),
            "ratio": round(flown * clock.seconds["alone"] / (60 * len(single)), 2),
            "mean_steps": round(float(np.mean([len(f) for f in flights]))),
            "resets_percent": round(100 * resets / clock.seconds["flown"], 2),
        }


def time_of_a_step(env: BatchEnvironment, work: Workload) -> Row:
    """Return µs per world and control step of each part of the batch environment's step, and of them all together."""
    simulation, clock = env.simulation, Stopwatch()
    env.set_state(work.start)
    for actions in work.actions:
        with clock.section("bookkeeping"):
            simulation.receive(actions)
        with clock.section("flight"):
            simulation.fly(SUBSTEPS)
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
    row: Row = {"steps_per_s": round(float(np.median(batch)))}
    for name, rate in rates.items():
        if name != "batch":
            ratio = batch / rate
            row[f"{name}_steps_per_s"] = round(float(np.median(rate)))
            row[f"ratio_{name}"] = round(float(np.median(ratio)), 3)
            row[f"range_{name}"] = f"{ratio.min():.2f}-{ratio.max():.2f}"
    return row


def _targets(row: Row) -> list[Target]:
    """What a cell's ratios should be."""
    raw = RAW_RATIO_MANIPULATION if row["task"] == MANIPULATION else RAW_RATIO
    wanted = (
        ("raw", raw, "raw mj_step"),
        ("gymnasium", GYMNASIUM_RATIO, "AsyncVectorEnv"),
        ("sb3", SB3_RATIO, "SubprocVecEnv"),
    )
    return [
        Target(
            what=f"{row['robot']}, {row['task']}: batch environment / {what}",
            sense="at least",
            limit=limit,
            measured=row[f"ratio_{key}"],
            spread=f"{row[f'range_{key}']} over repetitions",
        )
        for key, limit, what in wanted
        if f"ratio_{key}" in row
    ]


def _goals(row: Row) -> list[Target]:
    """What collecting demonstrations should reach."""
    return [
        Target(
            what=f"{row['robot']}: demonstrations flown per minute",
            sense="at least",
            limit=DEMONSTRATIONS_PER_MINUTE,
            measured=row["flown_per_minute"],
            spread=f"{row['ratio']} times one environment at a time",
        ),
        Target(
            what=f"{row['robot']}: share of the resets",
            sense="at most",
            limit=RESETS_PERCENT,
            measured=row["resets_percent"],
            unit="%",
        ),
    ]


BENCHMARK = Speed
