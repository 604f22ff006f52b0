"""Speed of simulation: beside the bare engine, and beside Gymnasium and Stable-Baselines3.

An expert's flight is recorded once and flown again by the batch environment and the bare engine, so that both do the
same work, contacts included: the bare engine is fed with the recorded actuator commands and wrenches and ends in the
same state bit for bit. The arms of a comparison take turns, and ratios are formed within a turn. Killed at any moment,
the same call continues with the cells that were not timed yet.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, TypedDict

import numpy as np

import aerial_il
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_json
from aerial_il.core.rendering import can_render
from aerial_il.evaluation.rollouts import rollouts
from aerial_il.suite.batch import BatchEnvironment
from experiments.common.figures import time_shares
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar, machine, settings_of
from experiments.common.stopwatch import Arm, Stopwatch, interleave
from experiments.speed.processes import process_arms
from experiments.speed.workload import RawPhysics, Workload, fly_again, record

MANIPULATION = "pick_place"
RAW_RATIO, RAW_RATIO_MANIPULATION = 0.70, 0.85
GYMNASIUM_RATIO, SB3_RATIO = 3.5, 4.0
DEMONSTRATIONS_PER_MINUTE, RESETS_PERCENT, RECORDING_PERCENT = 3000, 3.0, 15.0
SERIAL_WORLDS, SERIAL_US, FIRST_FLIGHT_S = 2048, 1.0, 3.0
CAMERAS, IMAGE_WORLDS, IMAGE_STEPS = ("wrist@64x64", "base@64x64"), 8, 20
SECTIONS = ("flight", "python")
SPEED = "Speed"
PARTS, SERIAL = "Time of a control step", f"Time of a control step of {SERIAL_WORLDS} worlds"
DEMONSTRATIONS = "Demonstrations per minute"
IMAGES = "Images"
TITLES = (SPEED, PARTS, SERIAL, IMAGES, DEMONSTRATIONS)
FIRST = """
import sys, time
started = time.perf_counter()
import aerial_il
robot, task, worlds, threads = *sys.argv[1:3], *map(int, sys.argv[3:])
env, expert = aerial_il.load_batch(robot, task, num_envs=worlds, num_threads=threads), aerial_il.expert(robot, task)
expert.attach(env)
obs = env.reset(0)
expert.reset()
env.step(expert.act(obs))
print(time.perf_counter() - started)
"""
RATES = "rates"  # no table: speeds in each repetition
NOTES = (
    "Steps per second: control steps of 20 ms (five physics steps) of all worlds together.",
    "Raw: mujoco.batch.Batch as its defaults give it, on the recorded scene, with the same threads and inputs, "
    "MuJoCo's timers off, one call per control step, for a policy has to see all worlds before it acts. Recorded: the "
    "same, handing out a state row of each world. Uninterrupted: in one call for the whole flight, which keeps each "
    "world in cache: the ceiling.",
    "With threads=1 and processes=0 the time of these arms is the processor's, else the wall's.",
    "Gymnasium: AsyncVectorEnv, SB3: Stable-Baselines3's SubprocVecEnv, over the single environment with the same "
    "actions, in pick_place; each of their processes steps one world.",
    "Ratios are medians over repetitions, with the smallest and largest; above 1 the batch environment is faster.",
    "Time of a control step: flight is what the compiled threads do; python is the rest, done by one thread.",
    f"Images: {' and '.join(CAMERAS)} of {IMAGE_WORLDS} worlds in every control step, by what steps without them take "
    "less; processor time.",
    "Demonstrations: the expert from reset to success, flown without recording, and recorded as MCAP files; recording: "
    "the share of collecting that flying does not explain.",
    "First flight: a fresh process from the import to the end of its first control step, kernels compiled before.",
)

Tables = dict[str, list[Row]]


class Timed(TypedDict):
    """What was timed of a cell, and how long that took."""

    tables: Tables
    seconds: float


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
    question: ClassVar[str] = "How much of the bare engine's speed is kept, and how much faster than processes is it?"

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
        """Time every cell that ``folder`` does not hold yet; see :class:`Study`."""
        cells = [c for c in aerial_il.list_cells() if c[0] in (self.robots or c) and c[1] in (self.tasks or c)]
        record = Record(folder)
        found = [self._kept(record, cell) for cell in bar(cells, self.name, progress)]
        first = first_flight(*cells[0], num_envs=self.num_envs, threads=self.threads, times=min(3, self.repetitions))
        return self._report(found, first, record)

    def _kept(self, record: Record, cell: tuple[str, str]) -> Timed:
        """Return what was timed of a cell on this machine, or time it."""
        settings = {name: value for name, value in settings_of(self).items() if name not in ("robots", "tasks")}
        file = record.place("cells", "-".join(cell), {"settings": settings, "machine": _processor()}) / "timed.json"
        if not file.exists():
            started = time.perf_counter()
            tables = self._timed(*cell)
            write_json(file, {"tables": tables, "seconds": time.perf_counter() - started})
        return json.loads(file.read_text(encoding="utf-8"))

    def _timed(self, robot: str, task: str) -> Tables:
        """Time a cell: title of a table -> its rows there."""
        head = {"robot": robot, "task": task}
        rates, share, flown = self._cell(robot, task)
        tables: Tables = {
            SPEED: [_compared(rates)],
            PARTS: [share],
            DEMONSTRATIONS: flown,
            RATES: [{"rates": {name: rate.round(1).tolist() for name, rate in rates.items()}}],
        }
        if task == MANIPULATION:
            tables[SERIAL] = [self._serial(robot, task)]
            tables[IMAGES] = [time_of_images(robot, task, self.seed)] if can_render() else []
        return {title: [{**head, **row} for row in rows] for title, rows in tables.items()}

    def _report(self, found: Sequence[Timed], first: Row, record: Record) -> Report:
        """Return the tables of all cells, and what is asked of them."""
        tables = {title: [row for cell in found for row in cell["tables"].get(title, ())] for title in TITLES}
        details = [row for cell in found for row in cell["tables"][RATES]]
        return Report(
            study=self,
            targets=(
                *(t for row in tables[SPEED] for t in targets_of(row)),
                *(t for row in tables[DEMONSTRATIONS] for t in _goals(row)),
                *(t for row in tables[SERIAL] for t in _serial_targets(row)),
                Target("first flight of a fresh process", "at most", FIRST_FLIGHT_S, first["median_s"], "s"),
            ),
            tables={**{title: rows for title, rows in tables.items() if rows}, "First flight": [first]},
            notes=(*NOTES, *record.notes()),
            figures={"speed.svg": _time_of_steps(tables[PARTS])},
            details={"repetitions": details},
            wall_time_s=sum(cell["seconds"] for cell in found),
        )

    def _cell(self, robot: str, task: str) -> tuple[dict[str, np.ndarray], Row, list[Row]]:
        """Time a cell in this process: rates of all arms, parts of a step, demonstrations per minute."""
        env = aerial_il.load_batch(robot, task, num_envs=self.num_envs, num_threads=self.threads)
        try:
            work = record(env, self.seed + np.arange(self.num_envs), self.steps)
            flown = [self._demonstrations(env)] if task == MANIPULATION and self.demonstrations else []
            return self._rates(env, work), time_of_a_step(env, work), flown
        finally:
            env.close()

    def _rates(self, env: BatchEnvironment, work: Workload) -> dict[str, np.ndarray]:
        """Control steps per second of each arm, one number per repetition."""
        raw = RawPhysics(env.model, work, self.threads)
        alone = self.threads == 1 and not self.processes
        timed = partial(Arm, units=work.world_steps, clock=time.process_time if alone else time.perf_counter)
        arms = {
            "batch": timed(lambda: fly_again(env, work), prepare=lambda: env.set_state(work.start)),
            "raw": timed(raw.step, prepare=raw.rewind),
            "recorded": timed(raw.step_recorded, prepare=raw.rewind),
            "uninterrupted": timed(raw.roll_out, prepare=raw.rewind),
        }
        count = min(self.processes, self.num_envs) if env.spec.task == MANIPULATION else 0
        with process_arms(env.spec.robot, env.spec.task, count, self.seed, work.actions) as others:
            return interleave({**arms, **others}, self.repetitions)

    def _demonstrations(self, env: BatchEnvironment) -> Row:
        """Successful episodes of the expert per minute, flown and recorded, and what resets and recording cost."""
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
            "recording_percent": round(100 * (1 - clock.seconds["flown"] / clock.seconds["recorded"]), 1),
        }

    def _serial(self, robot: str, task: str) -> Row:
        """Time the parts of a step of very many worlds, in which what a single thread does weighs most."""
        env = aerial_il.load_batch(robot, task, num_envs=SERIAL_WORLDS, num_threads=self.threads)
        try:
            return time_of_a_step(env, record(env, self.seed + np.arange(SERIAL_WORLDS), max(1, self.steps // 4)))
        finally:
            env.close()


def _time_of_steps(rows: Sequence[Row]) -> str:
    return time_shares(
        rows,
        {f"{name}_us": name for name in SECTIONS},
        named_by=("robot", "task"),
        title="Where the time of the batch environment goes",
        unit="µs per world and control step",
    )


def _processor() -> dict[str, Any]:
    """What of the machine decides speed and does not change from minute to minute."""
    return {name: value for name, value in machine().items() if name != "load_average"}


def first_flight(robot: str, task: str, *, num_envs: int, threads: int, times: int) -> Row:
    """Return how long a first control step takes in a fresh process; one before compiles what is missing."""
    command = [sys.executable, "-c", FIRST, robot, task, str(num_envs), str(threads)]
    taken = [
        float(subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()[-1])
        for _ in range(times + 1)
    ][1:]
    largest = round(max(taken), 2)
    return {"robot": robot, "task": task, "median_s": round(float(np.median(taken)), 2), "largest_s": largest}


def time_of_a_step(env: BatchEnvironment, work: Workload) -> Row:
    """Return µs per world and control step in the compiled flight, in the rest, and of both together."""
    clock, fly = Stopwatch(), env.simulation.fly

    def timed(steps: int) -> None:
        with clock.section("flight"):
            fly(steps)

    env.set_state(work.start)
    env.simulation.fly = timed  # pyright: ignore[reportAttributeAccessIssue]
    try:
        with clock.section("total"):
            fly_again(env, work)
    finally:
        del env.simulation.fly
    flight, total = (1e6 * clock.seconds[name] / work.world_steps for name in ("flight", "total"))
    return {"flight_us": round(flight, 2), "python_us": round(total - flight, 2), "total_us": round(total, 2)}


def time_of_images(robot: str, task: str, seed: int) -> Row:
    """Return the share of a control step that two cameras take, and their images per second."""
    taken = []
    for cameras in ((), CAMERAS):
        with closing(aerial_il.load_batch(robot, task, num_envs=IMAGE_WORLDS, num_threads=1, cameras=cameras)) as env:
            work = record(env, seed + np.arange(IMAGE_WORLDS), IMAGE_STEPS)
            env.set_state(work.start)
            started = time.process_time()
            fly_again(env, work)
            taken.append(time.process_time() - started)
    without, seeing = taken
    return {
        "images_per_s": round(work.world_steps * len(CAMERAS) / (seeing - without)),
        "images_percent": round(100 * (1 - without / seeing), 1),
    }


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


def targets_of(row: Row) -> list[Target]:
    """The targets of a cell's ratios."""
    raw = RAW_RATIO_MANIPULATION if row["task"] == MANIPULATION else RAW_RATIO
    wanted = (
        ("recorded", raw, "raw mj_step with a state row per world"),
        ("gymnasium", GYMNASIUM_RATIO, "AsyncVectorEnv"),
        ("sb3", SB3_RATIO, "SubprocVecEnv"),
    )
    return [
        _ratio(f"{row['robot']}, {row['task']}: batch environment / {what}", limit, row, key)
        for key, limit, what in wanted
        if f"ratio_{key}" in row
    ]


def _ratio(what: str, limit: float, row: Row, key: str) -> Target:
    return Target(what, "at least", limit, row[f"ratio_{key}"], "", f"{row[f'range_{key}']} over repetitions")


def _goals(row: Row) -> list[Target]:
    """The targets of collecting demonstrations."""
    robot, flown = row["robot"], row["flown_per_minute"]
    return [
        Target(f"{robot}: demonstrations flown per minute", "at least", DEMONSTRATIONS_PER_MINUTE, flown),
        Target(f"{robot}: share of the resets", "at most", RESETS_PERCENT, row["resets_percent"], "%"),
        Target(f"{robot}: recording's share", "at most", RECORDING_PERCENT, row["recording_percent"], "%"),
    ]


def _serial_targets(row: Row) -> list[Target]:
    what = f"{row['robot']}, {row['task']}: Python's time per world of {SERIAL_WORLDS}"
    return [Target(what, "at most", SERIAL_US, row["python_us"], "µs")]
