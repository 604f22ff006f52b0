"""The cost of recording: its share in collecting, and the speed of reading and converting.

Ours and, if asked for, an earlier commit do the same work in processes of their own, and take turns; ratios are formed
within a turn.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

import aerial_il
from aerial_il.benchmarks.parts.earlier.checkout import Checkout, Peer
from aerial_il.benchmarks.parts.reporting.progress import bar
from aerial_il.benchmarks.parts.reporting.report import Report, Row, Target
from aerial_il.core.errors import InvalidValueError

TASK = "pick_place"
OURS, EARLIER = "ours", "earlier"
SHARE_PERCENT, COLLECT_RATIO, READ_RATIO, CONVERT_RATIO = 15.0, 2.0, 2.0, 4.0
NOTES = (
    "Flown: the expert from reset to success, without recording. Collected: the same seeds as MCAP files on the "
    "disk, from the first reset to the finished index. Share: the part of the collecting time that flying does not "
    "explain.",
    "Read: every episode of the last collection, opened with open_dataset and checked. Converted: some of them to "
    "LeRobot's format, without images.",
    "Each side reads and converts what it has recorded itself, on the same disk; the files are cached, because they "
    "were just written. A first turn, which compiles and warms up, does not count.",
    "Ratios are medians over repetitions, with the smallest and largest; above 1 ours is faster.",
)
SCRIPT = """
import shutil, time
from pathlib import Path

import aerial_il
from aerial_il.collection.collect import collect
from aerial_il.data.dataset import open_dataset
from aerial_il.data.formats import lerobot
from aerial_il.evaluation.rollouts import rollouts

held = {}

def prepare(robot, task, num_envs, threads):
    if held:
        held["env"].close()
    held["cell"] = robot, task
    held["env"] = aerial_il.load_batch(robot, task, num_envs=num_envs, num_threads=threads)

def timed(work):
    started = time.perf_counter()
    done = work()
    return done / (time.perf_counter() - started)

def flown(first, count, folder):
    expert = aerial_il.expert(*held["cell"])
    return timed(lambda: sum(flight.success for flight in rollouts(held["env"], expert, range(first, first + count))))

def collected(first, count, folder):
    expert = aerial_il.expert(*held["cell"])
    shutil.rmtree(folder, ignore_errors=True)
    return timed(lambda: len(collect(held["env"], expert, range(first, first + count), folder, progress=False).demos))

def read(first, count, folder):
    return timed(lambda: sum(1 for _ in open_dataset(folder)))

def converted(first, count, folder):
    some = Path(folder, "some")
    some.mkdir(exist_ok=True)
    for file in sorted(Path(folder, "demos").glob("*.mcap"))[:count]:
        if not (some / file.name).exists():
            (some / file.name).symlink_to(file)
    return timed(lambda: len(open_dataset(lerobot.write(open_dataset(some), some / "derived"))))
"""


@dataclass(frozen=True, kw_only=True)
class Recording:
    """Settings.

    Attributes:
        robots: names; empty for all that do pick_place; the first one's files are read and converted.
        num_envs: worlds of the batch. demonstrations: episodes flown and recorded in a turn.
        converted: of these, converted in a turn; 0 leaves reading and converting out.
        repetitions: turns. seed: the first one flown. threads: of the simulation; 0 for all cores.
        parent: checkout of an earlier commit to compare with. parent_python: its interpreter, if not this one.
    """

    name: ClassVar[str] = "recording"
    question: ClassVar[str] = "How much does recording flights cost?"

    robots: tuple[str, ...] = ()
    num_envs: int = 256
    demonstrations: int = 1024
    converted: int = 64
    repetitions: int = 5
    seed: int = 10_000
    threads: int = 0
    parent: str | None = None
    parent_python: str | None = None

    def __post_init__(self) -> None:
        if min(self.num_envs, self.demonstrations, self.repetitions) < 1:
            raise InvalidValueError(
                "recording needs num_envs, demonstrations and repetitions of at least 1; got "
                f"{self.num_envs}, {self.demonstrations} and {self.repetitions}."
            )

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Time every robot; see :class:`Benchmark`."""
        started = time.perf_counter()
        able = [robot for robot, task in aerial_il.list_cells() if task == TASK and robot in (self.robots or (robot,))]
        sides = self._checkouts()
        collecting, files, details = [], [], []
        with self._served(sides) as peers, tempfile.TemporaryDirectory(prefix="aerial_il-") as scratch:
            for robot in bar(able, self.name, progress):
                for peer in peers.values():
                    peer.ask("prepare", robot=robot, task=TASK, num_envs=self.num_envs, threads=self.threads)
                found = self._measured(peers, Path(scratch), files=not details)
                collecting.append({"robot": robot, **_collecting(found)})
                files += [{"robot": robot, **row} for row in _files(found)]
                details.append({"robot": robot, **found})
        tables = {"Collecting": collecting, "Files": files}
        return Report(
            name=self.name,
            question=self.question,
            settings={**asdict(self), **{f"commit_{name}": side.commit for name, side in sides.items()}},
            targets=(*(t for row in collecting for t in _goals(row)), *(t for row in files for t in _file_goals(row))),
            tables={title: rows for title, rows in tables.items() if rows},
            notes=NOTES,
            details={"episodes_per_s": details},
            wall_time_s=time.perf_counter() - started,
        )

    def _checkouts(self) -> dict[str, Checkout]:
        ours = {OURS: Checkout.here()}
        return (
            {**ours, EARLIER: Checkout(Path(self.parent), self.parent_python or sys.executable)}
            if self.parent
            else ours
        )

    @contextmanager
    def _served(self, sides: Mapping[str, Checkout]) -> Iterator[dict[str, Peer]]:
        with ExitStack() as stack:
            yield {name: stack.enter_context(side.serve(SCRIPT)) for name, side in sides.items()}

    def _measured(self, peers: Mapping[str, Peer], scratch: Path, *, files: bool) -> dict[str, dict[str, list[float]]]:
        """Return what was done -> side -> episodes per second, one number per repetition."""
        counts = {"flown": self.demonstrations, "collected": self.demonstrations}
        if files and self.converted:
            counts |= {"read": self.demonstrations, "converted": self.converted}
        found: dict[str, dict[str, list[float]]] = {what: {name: [] for name in peers} for what in counts}
        for turn in range(self.repetitions + 1):
            for what, count in counts.items():
                for name, peer in peers.items():
                    rate = peer.ask(what, first=self.seed, count=count, folder=str(scratch / name))
                    if turn > 0:  # the first one warms up
                        found[what][name].append(rate)
        return found


def _collecting(found: Mapping[str, Mapping[str, list[float]]]) -> Row:
    """Demonstrations per minute flown and collected, the share of recording, and the ratio to an earlier commit."""
    row: Row = {}
    for name in found["flown"]:
        flown, collected = np.array(found["flown"][name]), np.array(found["collected"][name])
        share = 100.0 * (1.0 - collected / flown)
        prefix = "" if name == OURS else f"{name}_"
        row[f"{prefix}flown_per_minute"] = round(60 * float(np.median(flown)))
        row[f"{prefix}collected_per_minute"] = round(60 * float(np.median(collected)))
        row[f"{prefix}share_percent"] = round(float(np.median(share)), 1)
        row[f"{prefix}share_range"] = f"{share.min():.1f}-{share.max():.1f}"
    return {**row, **_compared(found["collected"])}


def _files(found: Mapping[str, Mapping[str, list[float]]]) -> list[Row]:
    """Episodes per second read and converted."""
    return [
        {
            "work": what,
            **{f"{name}_per_s": round(float(np.median(rates)), 1) for name, rates in found[what].items()},
            **_compared(found[what]),
        }
        for what in ("read", "converted")
        if what in found
    ]


def _compared(rates: Mapping[str, list[float]]) -> Row:
    if EARLIER not in rates:
        return {}
    ratio = np.array(rates[OURS]) / np.array(rates[EARLIER])
    return {"ratio": round(float(np.median(ratio)), 2), "range": f"{ratio.min():.2f}-{ratio.max():.2f}"}


def _goals(row: Row) -> Iterator[Target]:
    """The targets of collecting."""
    yield Target(
        what=f"{row['robot']}: share of recording in collecting",
        sense="at most",
        limit=SHARE_PERCENT,
        measured=row["share_percent"],
        unit="%",
        spread=f"{row['share_range']} over repetitions",
    )
    if "ratio" in row:
        yield _ratio_target(row, "demonstrations collected per minute", COLLECT_RATIO)


def _file_goals(row: Row) -> Iterator[Target]:
    if "ratio" in row:
        yield _ratio_target(
            row, f"episodes {row['work']} per second", READ_RATIO if row["work"] == "read" else CONVERT_RATIO
        )


def _ratio_target(row: Row, what: str, limit: float) -> Target:
    return Target(
        what=f"{row['robot']}: {what}, times the earlier commit's",
        sense="at least",
        limit=limit,
        measured=row["ratio"],
        spread=f"{row['range']} over repetitions",
    )


BENCHMARK = Recording
