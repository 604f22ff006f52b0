"""Recordings flown again, bit for bit: flights of a batch by one world alone, from the start and from the middle."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import aerial_il
from aerial_il.collection.collect import collect
from aerial_il.core.errors import DemoError, InvalidValueError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.replay import replay
from aerial_il.evaluation.statistics import wilson
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar

NOTES = (
    "Recorded: the expert's flights, successes and failures, in a batch on two threads. Flown again: the executed "
    "actions, by one world alone on one thread, from the first step and from the middle one. Equal: every state, "
    "reward and outcome has the same bits.",
    "The interval is Wilson's of 95 % over the flights.",
)


@dataclass(frozen=True, kw_only=True)
class Replay:
    """Settings.

    Attributes:
        robots, tasks: names; empty for all. tiers: names. episodes: flights of each cell in each tier.
        seed: of the first. num_envs: worlds of the batch that is recorded.
    """

    name: ClassVar[str] = "replay"
    question: ClassVar[str] = "Do recordings replay bit for bit, alone as in a batch, on any number of threads?"

    robots: tuple[str, ...] = ()
    tasks: tuple[str, ...] = ()
    tiers: tuple[str, ...] = ("calm", "hard")
    episodes: int = 8
    seed: int = 10_000
    num_envs: int = 8

    def __post_init__(self) -> None:
        if min(self.episodes, self.num_envs) < 1 or not self.tiers:
            raise InvalidValueError("episodes and num_envs start at 1; tiers name at least one.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Record what ``folder`` does not hold yet, and fly all of it again; see :class:`Study`."""
        started, record = time.perf_counter(), Record(folder)
        cells = [c for c in aerial_il.list_cells() if c[0] in (self.robots or c) and c[1] in (self.tasks or c)]
        rows = [row for cell in bar(cells, self.name, progress) for row in self.table_rows(*cell, record)]
        return Report(
            study=self,
            targets=[
                Target(f"{r['robot']}, {r['task']}, {r['tier']}", "at least", 100, r["percent"], "%") for r in rows
            ],
            tables={"Flights with equal bits": rows},
            notes=(*NOTES, *record.notes()),
            wall_time_s=time.perf_counter() - started,
        )

    def table_rows(self, robot: str, task: str, record: Record) -> Iterator[Row]:
        """Yield a row for each tier."""
        seeds = range(self.seed, self.seed + self.episodes)
        for tier in self.tiers:
            place = record.place("datasets", f"{robot}-{task}/{tier}", {"seeds": [seeds.start, seeds.stop]})
            with closing(aerial_il.load_batch(robot, task, num_envs=self.num_envs, tier=tier, num_threads=2)) as env:
                collect(env, aerial_il.expert(robot, task), seeds, place, progress=False)
            equal = self._equal(robot, task, tier, place)
            low, high = (round(100 * end, 1) for end in wilson(equal, self.episodes))
            yield {
                "robot": robot, "task": task, "tier": tier, "success": equal, "episodes": self.episodes,
                "percent": 100.0 * equal / self.episodes, "ci95_low": low, "ci95_high": high,
            }  # fmt: skip

    def _equal(self, robot: str, task: str, tier: str, place: Path) -> int:
        """Return how many recordings were flown again with equal bits."""
        equal = 0
        with closing(aerial_il.load_batch(robot, task, num_envs=1, tier=tier, num_threads=1)) as env:
            for episode in open_dataset(place, failures=True):
                try:
                    replay(env, episode, starts=(0, len(episode) // 2))
                except DemoError:
                    continue
                equal += 1
        return equal
