"""The cost of recording: its share in collecting, and the speed of reading and converting."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

import aerial_il
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.formats import lerobot
from aerial_il.evaluation.rollouts import rollouts
from experiments.common.report import Report, Row, Target, bar

TASK = "pick_place"
SHARE_PERCENT = 15.0
NOTES = (
    "Flown: the expert from reset to success, without recording. Collected: the same seeds as MCAP files on the "
    "disk, from the first reset to the finished index. Share: the part of the collecting time that flying does not "
    "explain.",
    "Read: every episode of the last collection, opened with open_dataset and checked. Converted: some of them to "
    "LeRobot's format, without images. The files are cached, because they were just written.",
    "All take turns; shares are formed within a turn, and are medians over turns, with the smallest and largest. A "
    "first turn, which compiles and warms up, does not count.",
)


@dataclass(frozen=True, kw_only=True)
class Recording:
    """Settings.

    Attributes:
        robots: names; empty for all that do pick_place; the first one's files are read and converted.
        num_envs: worlds of the batch. demonstrations: episodes flown and recorded in a turn.
        converted: of these, converted in a turn; 0 leaves reading and converting out.
        repetitions: turns. seed: the first one flown. threads: of the simulation; 0 for all cores.
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

    def __post_init__(self) -> None:
        if min(self.num_envs, self.demonstrations, self.repetitions) < 1:
            raise InvalidValueError(
                "recording needs num_envs, demonstrations and repetitions of at least 1; got "
                f"{self.num_envs}, {self.demonstrations} and {self.repetitions}."
            )

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Time every robot; see :class:`Study`."""
        started = time.perf_counter()
        able = [robot for robot, task in aerial_il.list_cells() if task == TASK and robot in (self.robots or (robot,))]
        collecting, files, details = [], [], []
        for robot in bar(able, self.name, progress):
            found = self._measured(robot, files=not details)
            collecting.append({"robot": robot, **collecting_row(found)})
            files += [{"robot": robot, **row} for row in file_rows(found)]
            details.append({"robot": robot, **found})
        tables = {"Collecting": collecting, "Files": files}
        return Report(
            study=self,
            targets=tuple(map(_target, collecting)),
            tables={title: rows for title, rows in tables.items() if rows},
            notes=NOTES,
            details={"episodes_per_s": details},
            wall_time_s=time.perf_counter() - started,
        )

    def _measured(self, robot: str, *, files: bool) -> dict[str, list[float]]:
        """Return what was done -> episodes per second, one number per turn."""
        env = aerial_il.load_batch(robot, TASK, num_envs=self.num_envs, num_threads=self.threads)
        with tempfile.TemporaryDirectory(prefix="aerial_il-") as scratch:
            folder, seeds = Path(scratch), range(self.seed, self.seed + self.demonstrations)
            work: dict[str, Callable[[], int]] = {
                "flown": lambda: sum(f.success for f in rollouts(env, aerial_il.expert(robot, TASK), seeds)),
                "collected": lambda: len(
                    collect(env, aerial_il.expert(robot, TASK), seeds, folder / "data", progress=False).demos
                ),
            }
            if files and self.converted:
                work["read"] = lambda: sum(1 for _ in open_dataset(folder / "data"))
                work["converted"] = lambda: self._converted(folder)
            found: dict[str, list[float]] = {what: [] for what in work}
            try:
                for turn in range(self.repetitions + 1):
                    shutil.rmtree(folder / "data", ignore_errors=True)
                    for what, do in work.items():
                        started = time.perf_counter()
                        rate = do() / (time.perf_counter() - started)
                        found[what] += [rate] if turn else []
            finally:
                env.close()
        return found

    def _converted(self, folder: Path) -> int:
        """Convert some of the files and return how many."""
        some = folder / "some"
        shutil.rmtree(some, ignore_errors=True)
        some.mkdir()
        for file in sorted((folder / "data" / "demos").glob("*.mcap"))[: self.converted]:
            (some / file.name).symlink_to(file)
        return len(open_dataset(lerobot.write(open_dataset(some), some / "derived")))


def collecting_row(found: Mapping[str, list[float]]) -> Row:
    """Return demonstrations per minute flown and collected, and the share of recording."""
    flown, collected = np.array(found["flown"]), np.array(found["collected"])
    share = 100.0 * (1.0 - collected / flown)
    return {
        "flown_per_minute": round(60 * float(np.median(flown))),
        "collected_per_minute": round(60 * float(np.median(collected))),
        "share_percent": round(float(np.median(share)), 1),
        "share_range": f"{share.min():.1f}-{share.max():.1f}",
    }


def file_rows(found: Mapping[str, list[float]]) -> Iterator[Row]:
    """Yield how many episodes per second are read and converted."""
    for what in ("read", "converted"):
        if what in found:
            yield {"work": what, "episodes_per_s": round(float(np.median(found[what])), 1)}


def _target(row: Row) -> Target:
    what, spread = f"{row['robot']}: share of recording in collecting", f"{row['share_range']} over repetitions"
    return Target(what, "at most", SHARE_PERCENT, row["share_percent"], "%", spread)
